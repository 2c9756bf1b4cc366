"""Where each solver lane misses a cost gap of 1e-9, problem by problem.

A lane is judged at its setting for 1e-9, or at the one that is right on most problems, from a cold start in the first
scaling. Gap and violation are those of the first answer, ``timed_gap`` is the largest gap or violation of the answers
that were judged among the timed ones.
"""

import pandas as pd

from bench.derived.measurements import Measurements, at_tiers
from bench.messages.verdict import Tier

COLUMNS = ["solver", "lane", "problem_set", "problem", "settings", "status"]
FIGURES = ["cost_gap", "timed_gap", "violation", "answer_us"]


def misses(measurements: Measurements) -> pd.DataFrame:
    """COLUMNS and FIGURES, one row for each solver lane and problem that it misses; lanes with the fewest misses first.

    A lane that is right on no problem is left out: its problems do not differ. Settings are {} where a solver crashed.
    """
    rows = measurements.field
    rows = rows[(rows.start == "cold") & (rows.scaling == measurements.scaling)]
    judged = at_tiers(rows, measurements.settings, "furthest")
    judged = judged[judged.tier == Tier.HIGH].astype({"right": bool})
    missed = judged.assign(count=~judged.right, some=judged.right)
    counts = missed.groupby(["solver", "lane"])[["count", "some"]].transform("sum")
    missed = missed.assign(**counts)[~judged.right & (counts.some > 0)]
    order = ["count", "solver", "lane", "problem"]
    return missed.fillna({"settings": "{}"}).sort_values(order, ignore_index=True)[COLUMNS + FIGURES]
