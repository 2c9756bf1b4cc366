"""Cost of calling a library through a wrapper: ratio of its time to that in the lane direct, at the same settings.

Only problems count on which both are right to 1e-3. The excess over 1 is the cost of conversion and repeated set-up.
"""

from typing import Any

import pandas as pd

from bench.derived.accuracy import right
from bench.derived.measurements import Measurements
from bench.derived.statistics import TYPICAL
from bench.messages.columns import Column, combined
from bench.messages.verdict import Tier
from bench.report.words import number, settings_label
from piezo_model.json_file import decoded
from solvers import Lane
from solvers.registry import FAMILIES

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
