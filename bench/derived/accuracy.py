"""Error of a measured answer relative to the tolerance of a tier, from its row of the table alone.

    error = max(cost gap, violation, worst of the timed answers) / tolerance
    error = max(stage excess / 0.1, violation / 1e-3), timed answers included  for the tier `stage`

An answer is right if error ≤ 1, and right with margin m if m · error ≤ 1. A library's defaults have the tolerance of
`low`.
"""

from __future__ import annotations

import math

import pandas as pd

from bench.messages.verdict import Status, Tier

TOLERANCE = {Tier.DEFAULT: 1e-3, Tier.LOW: 1e-3, Tier.MID: 1e-6, Tier.HIGH: 1e-9, Tier.EXACT: 1e-12}
"""Largest relative cost gap and violation."""
UNNOTICED = 0.1
"""Largest difference of two RMS errors on unseen data, over the sensor's noise, that does not count."""
MEASURED = ["problem_set", "problem", "scaling", "solver", "lane"]


def applies(rows: pd.DataFrame, tier: Tier) -> pd.Series[bool]:
    """Whether each row's problem has this tier; the tier `stage` needs the sensor's noise."""
    return rows.noise_um > 0.0 if tier is Tier.STAGE else pd.Series(True, index=rows.index)


def error(rows: pd.DataFrame, tier: Tier) -> pd.Series[float]:
    """Error of each answer relative to the tolerance of the tier; infinite if its status is not ok."""
    if tier is not Tier.STAGE:
        return distance(rows) / TOLERANCE[tier]
    first = (rows.stage_excess / UNNOTICED, rows.violation / TOLERANCE[Tier.LOW])
    timed = (rows.timed_stage_excess / UNNOTICED, rows.timed_violation / TOLERANCE[Tier.LOW])
    return _worst(rows, *first, *(part.fillna(0.0) for part in timed)).clip(lower=0.0)


def distance(rows: pd.DataFrame) -> pd.Series[float]:
    """Largest of cost gap, violation and the timed answers' gap; infinite if the status is not ok."""
    return _worst(rows, rows.cost_gap, rows.violation, rows.timed_gap.fillna(0.0))


def _worst(rows: pd.DataFrame, *parts: pd.Series) -> pd.Series[float]:
    return pd.concat(parts, axis=1).max(axis=1, skipna=False).fillna(math.inf).mask(rows.status != Status.OK, math.inf)


def measured(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows without those that were not run but measured in another repeat: that a time limit cut a ladder short is
    no evidence about the answer."""
    skipped = rows.status == Status.NOT_RUN
    measured_once = (~skipped).groupby([rows[name] for name in (*MEASURED, "setting", "start")]).transform("any")
    return rows[~(skipped & measured_once)]


def supported(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows without those of programs that a solver cannot take, which are no misses."""
    return rows[rows.status != Status.UNSUPPORTED]


def right(rows: pd.DataFrame, tier: Tier) -> pd.Series[bool]:
    """Whether each answer meets the tier."""
    return error(rows, tier) <= 1.0
