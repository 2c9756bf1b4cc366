"""Cost of calling a library through a wrapper: ratio of its time to that in the lane direct, at the same settings.

Only problems count on which both are right to 1e-3. The excess over 1 is the cost of conversion and repeated set-up.
"""

from typing import Any

import pandas as pd

from bench.derived.accuracy import right
from bench.derived.measurements import Measurements
from bench.messages.verdict import Tier
from piezo_model.json_file import decoded
from solvers import Lane
from solvers.registry import FAMILIES

OTHER_NAMES = {"highs": "highspy", "proxqp": "proxsuite"}
"""Names in the lane direct of libraries that qpsolvers and cvxpy call differently."""
REPORTING = {"raise_error"}
"""Settings that affect how a failure is reported, but not the answer."""
COLUMNS = ["solver", "lane", "settings", "problems", "us", "direct_us", "ratio"]


def in_lane_direct(solver: str) -> str:
    """Name in the lane direct of a library that a wrapper calls."""
    return OTHER_NAMES.get(solver, solver)


def wrapper_share(measurements: Measurements) -> pd.DataFrame:
    """COLUMNS, one row per wrapper and setting that the lane direct has, too; medians over the ``problems`` on which
    both are right."""
    rows = measurements.field[
        (measurements.field.start == "cold") & (measurements.field.scaling == measurements.scaling)
    ]
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
    table = (
        both.groupby(["solver", "lane", "setting"], sort=True)
        .agg(
            settings=("settings", "first"),
            problems=("ratio", "size"),
            us=("us", "median"),
            direct_us=("direct_us", "median"),
            ratio=("ratio", "median"),
        )
        .reset_index()
    )
    return table[COLUMNS]


def _key(settings: str) -> str:
    """The settings that affect the answer, as a text; "" for defaults, which differ between packages."""
    effective = {name: value for name, value in decoded(settings, dict[str, Any]).items() if name not in REPORTING}
    return repr(sorted(effective.items())) if effective else ""
