"""What an answer takes in a run, row by row: the logarithm of the median time of update and solve, in turns or hot.

In turns all solvers of a problem share the machine's moment, so these times are taken wherever both runs have them; hot times
serve for the rows that had no turns. Each solver lane takes turns at one setting, which may differ between the runs.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.derived.accuracy import MEASURED
from bench.derived.answer_times import HOT, IN_TURNS, by_task
from bench.derived.table import ONESHOT
from bench.store import Run
from bench.timing.clock import Effort

FEWEST = Effort().fewest
"""Times that a level needs: what the slowest solver is timed at the least."""
NAMES = [*MEASURED, "setting", "start"]
"""What a row of one run has in common with that of another one."""


BETTER = "in turns"
WAYS = {BETTER: IN_TURNS, "hot": HOT}
"""How answers are timed, and how the names begin under which a run keeps it."""


def log_ratios(a: Run, b: Run) -> pd.DataFrame:
    """One row a task and repeat that both runs timed: ``task`` (of a), ``repeat``, ``timed``, ``log_ratio`` (b over a) and NAMES."""
    both = levels(a).merge(levels(b), on=[*NAMES, "repeat", "timed"], suffixes=("", "_b"))
    better = both.task.isin(both.task[both.timed == BETTER])
    both = both[(both.timed == BETTER) | ~better]
    return both.assign(log_ratio=both.level_b - both.level).drop(columns=["level", "level_b", "task_b"])


def levels(run: Run) -> pd.DataFrame:
    """One row a task, repeat and way of timing: ``task``, NAMES, ``repeat``, ``timed`` and ``level``, the logarithm of µs."""
    found = [(task, repeat, timed, np.log(max(np.median(us), 1e-3)))
             for repeat, times in run.times().groupby("repeat") for timed, way in WAYS.items()
             for task, (us,) in by_task(times, [way]).items() if us.size >= FEWEST]
    named = run.rows(ONESHOT).drop_duplicates("task")[["task", *NAMES]]
    return named.merge(pd.DataFrame(found, columns=["task", "repeat", "timed", "level"]), on="task")


def sentinel_level(run: Run) -> float:
    """Nanoseconds of the fixed piece of work: the median over all looks at the machine."""
    return float(run.looks().level_ns.median())
