"""What calling a library through another package costs: its time over that of the same library in the lane direct, at
the same settings.

Problems are compared on which both are right to 1e-3. What is above 1 is the price of conversion and repeated set-up.
"""

from typing import Any

import pandas as pd

from bench.derived.accuracy import right
from bench.derived.measurements import Measurements
from piezo_model.json_file import decoded
from solvers import Lane, Tier
from solvers.registry import FAMILIES

OTHER_NAMES = {"highs": "highspy", "proxqp": "proxsuite"}
"""Of libraries that qpsolvers and cvxpy call otherwise than the lane direct does."""
SAYS_NOTHING = {"raise_error"}
"""Settings that say how a failure is said."""
COLUMNS = ["solver", "lane", "settings", "problems", "us", "direct_us", "ratio"]


def in_lane_direct(solver: str) -> str:
    """The name of a wrapper's library in the lane direct."""
    return OTHER_NAMES.get(solver, solver)


def wrapper_share(found: Measurements) -> pd.DataFrame:
    """One row a wrapper and setting that both lanes were asked for: COLUMNS, medians over the ``problems`` where both
    are right."""
    rows = found.field[(found.field.start == "cold") & (found.field.scaling == found.scaling)]
    rows = rows.assign(us=rows.total_us, asked=rows.settings.map(_asked), library=rows.solver.map(in_lane_direct))
    rows = rows[right(rows, Tier.LOW) & (rows.asked != "")]
    direct = (
        rows[rows.lane == Lane.DIRECT].drop(columns="library").rename(columns={"solver": "library", "us": "direct_us"})
    )
    same = ["problem_set", "problem", "library", "asked"]
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


def _asked(settings: str) -> str:
    """What a lane was asked for, as far as it changes the answer; "" for nothing, of which each package makes what it
    will."""
    known = {name: value for name, value in decoded(settings, dict[str, Any]).items() if name not in SAYS_NOTHING}
    return repr(sorted(known.items())) if known else ""
