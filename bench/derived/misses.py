"""Where each solver lane misses a cost gap of 1e-9, problem by problem.

A lane is judged at its setting for 1e-9, or at the one that is right on most problems, from a cold start in the first
scaling. Gap and violation are those of the first answer, ``timed_gap`` is the largest gap or violation of the answers
that were judged among the timed ones.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pandas as pd

from bench.derived.measurements import Measurements, at_tiers
from bench.derived.tiers import distance
from bench.messages.task import Tier
from bench.problem_files.miss import Miss
from bench.problems.fresh import mixture
from bench.store import Run, RunError
from solvers.certificate import NotCertified


def misses(measurements: Measurements, hopeless: bool = False) -> pd.DataFrame:
    """The rows of the field, one for each solver lane and problem that it misses; lanes with the fewest misses first.

    A lane that is right on no problem is left out unless they are wanted: its problems do not differ. Settings are {}
    where a solver crashed.
    """
    judged = at_tiers(measurements.cold(measurements.field), measurements.settings, "furthest")
    judged = judged[judged.tier == Tier.HIGH].astype({"right": bool})
    missed = judged.assign(count=~judged.right, some=judged.right)
    counts = missed.groupby(["solver", "lane"])[["count", "some"]].transform("sum")
    missed = missed.assign(**counts)[~judged.right & (hopeless | (counts.some > 0))]
    order = ["count", "solver", "lane", "problem"]
    return missed.fillna({"settings": "{}"}).sort_values(order, ignore_index=True)


def kept(run: Run, measurements: Measurements, most: int) -> Iterator[tuple[str, Miss]]:
    """The worst missed answers of at most ``most`` solver lanes, those with the fewest misses first, with names for
    their files; the answer of each is the first one, or the worst timed one that was judged if that is worse."""
    missed = misses(measurements, hopeless=True)
    worst = missed.assign(gap=missed[["cost_gap", "timed_gap"]].max(axis=1)).sort_values("gap", ascending=False)
    for line in worst.drop_duplicates(["solver", "lane"]).sort_index().head(most).to_dict("records"):
        rows = measurements.every[measurements.every.task == line["task"]]
        *_, row = rows.assign(distance=distance(rows)).sort_values("distance").to_dict("records")
        with suppress(RunError, NotCertified):  # a miss without its problem is still in the table
            form = first = run.problem(row["problem_set"], row["problem"]).forms[row["scaling"]]
            x = row["answer"]
            if row["judged"] and row["timed_gap"] > max(row["cost_gap"], row["violation"]):
                form, x = mixture(first, row["timed_shares"], row["timed_factors"]), row["timed_answer"]
            optimum = np.array(form.certificate.x)
            yield (
                f"{row['solver']}-{row['lane']}-{row['problem_set']}--{row['problem']}.npz",
                Miss(row["solver"], row["lane"], row["settings"], first.qp, form.qp, x, optimum, form.yardstick),
            )
