"""Ratios of times at the same accuracy and on the same problems: our fastest solver of each lane to each of the others,
and a library through a wrapper to the same in the lane direct.

    ratio = median time of ours over the problems of a size / median time of the other

at the settings for a cost gap of 1e-9, from a cold start, for each number of unknowns. *Hot* calls follow each other
directly; *interleaved* with the other solvers, each call finds the caches that they left.

A wrapper is compared at the same settings, on problems on which both are right to 1e-3. The excess over 1 is the cost
of conversion and repeated set-up.
"""

from typing import Any

import pandas as pd

from bench.derived.measurements import HOT, INTERLEAVED, Measurements
from bench.derived.statistics import TYPICAL
from bench.derived.tiers import right
from bench.messages.columns import Column, combined
from bench.messages.task import Tier
from bench.report.words import marked, number, settings_label
from piezo_model.json_file import decoded
from solvers import Lane
from solvers.registry import FAMILIES, OURS

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


OTHER_NAMES = {"highs": "highspy", "proxqp": "proxsuite"}
"""Names in the lane direct of libraries that qpsolvers and cvxpy call differently."""
REPORTING = {"raise_error"}
"""Settings that affect how a failure is reported, but not the answer."""
WRAPPERS = (
    Column("solver", heading="solver"),
    Column("lane", heading="lane"),
    Column("settings", None, "first", "settings", settings_label),
    Column("problems", None, "size", "problems", of="ratio"),
    Column("us", None, TYPICAL, "µs", number),
    Column("direct_us", None, TYPICAL, "direct, µs", number),
    Column("ratio", None, TYPICAL, "ratio", number),
)


def in_lane_direct(solver: str) -> str:
    """Name in the lane direct of a library that a wrapper calls."""
    return OTHER_NAMES.get(solver, solver)


def wrapper_share(measurements: Measurements) -> pd.DataFrame:
    """WRAPPERS, one row per wrapper and setting that the lane direct has, too; medians over the ``problems`` on which
    both are right."""
    rows = measurements.cold(measurements.field)
    rows = rows.assign(us=rows.answer_us, key=rows.settings.map(_key), library=rows.solver.map(in_lane_direct))
    rows = rows[right(rows, Tier.LOW) & (rows.key != "")]
    direct = (
        rows[rows.lane == Lane.DIRECT].drop(columns="library").rename(columns={"solver": "library", "us": "direct_us"})
    )
    same = ["problem_set", "problem", "library", "key"]
    both = rows[rows.lane.isin([str(lane) for lane in FAMILIES])].merge(
        direct[[*same, "direct_us"]].drop_duplicates(same), on=same
    )
    both = both.assign(ratio=both.us / both.direct_us)
    return combined(both, WRAPPERS, ["solver", "lane", "setting"])


def _key(settings: str) -> str:
    """The settings that affect the answer, as a text; "" for defaults, which differ between packages."""
    effective = {name: value for name, value in decoded(settings, dict[str, Any]).items() if name not in REPORTING}
    return repr(sorted(effective.items())) if effective else ""
