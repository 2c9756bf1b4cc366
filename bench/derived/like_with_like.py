"""Our fastest solver of each lane against each of the others, at the same accuracy and on the same problems.

    ratio = median time of ours over the problems of a size / median time of the other

at the settings for a cost gap of 1e-9, from a cold start, for each number of unknowns. *Hot* calls follow each other
directly; *interleaved* with the other solvers, each call finds the caches that they left.
"""

import pandas as pd

from bench.derived.measurements import HOT, INTERLEAVED, Measurements
from bench.messages.verdict import Tier
from bench.report.words import marked
from solvers.registry import OURS

COLUMNS = ["lane", "timed", "d", "problems", "ours", "ours_us", "other", "other_us", "ratio"]


def like_with_like(measurements: Measurements) -> pd.DataFrame:
    """COLUMNS, one row per lane, way of timing, number of unknowns d and other solver that reaches 1e-9, the fastest
    first."""
    rows = measurements.cold(measurements.tiers[measurements.tiers.tier == Tier.HIGH])
    lines = []
    for timed, us in ((HOT, rows.answer_us), (INTERLEAVED, rows.interleaved_us)):
        for lane, part in rows.assign(us=us).dropna(subset="us").groupby("lane"):
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
