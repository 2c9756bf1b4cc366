"""Our solvers beside each of the others, in the same lane, at the same accuracy, on the same problems.

    ratio = median over the problems of a size of ours / that of the other

at the settings that stand for 1e-9, from a cold start, for each number of unknowns; ours is the one that is fastest in
the lane on all of them. *Hot* calls follow each other, and *in turns* each finds the caches that the other solvers
left.
"""

import numpy as np
import pandas as pd

from bench.derived.measurements import WAYS, Measurements, by_task
from bench.report.words import marked
from solvers import Tier
from solvers.registry import OURS

COLUMNS = ["lane", "timed", "d", "problems", "ours", "ours_us", "other", "other_us", "ratio"]


def like_with_like(found: Measurements) -> pd.DataFrame:
    """One row a lane, way of timing, number of unknowns d and other solver, the fastest first: COLUMNS; of those that
    reach 1e-9."""
    rows = found.tiers[
        (found.tiers.tier == Tier.HIGH) & (found.tiers.start == "cold") & (found.tiers.scaling == found.scaling)
    ]
    lines = []
    for timed in WAYS:
        us = {task: float(np.median(np.concatenate(calls))) for task, calls in by_task(found.times, (timed,)).items()}
        for lane, part in rows.assign(us=rows.task.map(us)).dropna(subset="us").groupby("lane"):
            ours, others = part[part.solver.isin(OURS)], part[~part.solver.isin(OURS)]
            if ours.empty:
                continue
            best = ours.groupby("solver").us.median().idxmin()
            for d, mine in ours[ours.solver == best].groupby("d"):
                own = float(mine.us.median())
                lines += [
                    (lane, timed, d, len(mine), marked(str(best)), own, other, median, own / median)
                    for other, median in others[others.d == d].groupby("solver").us.median().sort_values().items()
                ]
    return pd.DataFrame(lines, columns=COLUMNS)
