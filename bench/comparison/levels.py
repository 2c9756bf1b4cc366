"""What an answer takes in a run, row by row: the logarithm of the median time of update and solve, in turns or hot.

In turns all solvers of a problem share the machine's moment, so these times are taken wherever both runs have them; hot times
serve for the rows that had no turns.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.races.oneshot.answer_times import HOT, IN_TURNS
from bench.races.oneshot.rows import ONESHOT
from bench.store import Run
from bench.timing.clock import Effort
from solvers import Tier

FEWEST = Effort().fewest
"""Times that a level needs: what the slowest solver is timed at the least."""
NAMES = ["problem_set", "problem", "scaling", "solver", "lane", "tier", "start"]


BETTER = "in turns"
WAYS = {BETTER: IN_TURNS, "hot": HOT}
"""How answers are timed, and how the names begin under which a run keeps it."""


def log_ratios(a: Run, b: Run) -> pd.DataFrame:
    """One row a pair of tasks that serve one tier and a repeat that both runs timed: ``task`` (of a), ``repeat``, ``timed``,
    ``log_ratio`` (b over a) and NAMES; of the tiers that two tasks both serve the first, and none for the picture.
    """
    first, second = (levels(run).merge(served(run), on="task") for run in (a, b))
    both = first.merge(second, on=[*NAMES, "repeat", "timed"], suffixes=("_a", "_b"))
    both = both.drop_duplicates(["task_a", "task_b", "repeat", "timed"])
    better = both.task_a.isin(both.task_a[both.timed == BETTER])
    both = both[(both.timed == BETTER) | ~better]
    both = both.assign(log_ratio=both.level_b - both.level_a).rename(columns={"task_a": "task"})
    return both.drop(columns=["level_a", "level_b", "task_b"])


def served(run: Run) -> pd.DataFrame:
    """The tasks of a run with NAMES, once for each tier; without those for the picture."""
    rows = run.rows(ONESHOT)
    return rows.loc[rows.tier != Tier.RUNG, ["task", *NAMES]]


def levels(run: Run) -> pd.DataFrame:
    """One row a task, repeat and way of timing: ``task``, ``repeat``, ``timed`` and ``level``, the logarithm of ns."""
    times, found = run.times(), []
    for timed, way in WAYS.items():
        both = [times[times.what == f"{way}{what}"].set_index(["task", "repeat"]).ns for what in ("update", "solve")]
        joined = pd.concat(both, axis=1, join="inner", keys=("updates", "solves"))
        for (task, repeat), updates, solves in zip(joined.index, joined.updates, joined.solves, strict=True):
            if min(len(updates), len(solves)) >= FEWEST:
                found.append((task, repeat, timed, np.log(max(np.median(updates) + np.median(solves), 1.0))))
    return pd.DataFrame(found, columns=["task", "repeat", "timed", "level"])


def sentinel_level(run: Run) -> float:
    """Nanoseconds of the fixed piece of work: the median over all looks at the machine."""
    return float(run.looks().level_ns.median())
