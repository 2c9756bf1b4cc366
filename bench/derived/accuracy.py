"""Whether a measured answer is right: how far it is from what a tier asks, from one row of the table alone.

    error = max(cost gap, violation, those of the timed answers) / tolerance
    error = max(stage excess / 0.01, violation / 1e-3)                           for the tier `stage`, by the first
    answer

An answer is right where error ≤ 1, and at a margin m where m · error ≤ 1. A library's defaults are judged like `low`.
"""

from __future__ import annotations

import math

import pandas as pd

from solvers import Status, Tier

TOLERANCE = {Tier.DEFAULT: 1e-3, Tier.LOW: 1e-3, Tier.MID: 1e-6, Tier.HIGH: 1e-9, Tier.EXACT: 1e-12}
"""Largest relative cost gap and violation."""
UNNOTICED = 0.01
"""Stage excess that the stage does not notice."""
CHEATS = (Status.LAZY, Status.STALE, Status.CACHED, Status.MISTIMED, Status.PEEKED, Status.TAMPERED)
"""What counts against every setting of a solver on a problem, since only one of them is looked into closely."""
MEASURED = ["problem_set", "problem", "scaling", "solver", "lane"]


def applies(rows: pd.DataFrame, tier: Tier) -> pd.Series[bool]:
    """Rows of problems that have such a tier; the stage's needs to know the noise."""
    return rows.noise_um > 0.0 if tier is Tier.STAGE else pd.Series(True, index=rows.index)


def error(rows: pd.DataFrame, tier: Tier) -> pd.Series[float]:
    """Error of each answer in tolerances of the tier, infinite where it is not ok."""
    if tier is not Tier.STAGE:
        return distance(rows) / TOLERANCE[tier]
    return _worst(rows, (rows.stage_excess / UNNOTICED).clip(lower=0.0), rows.violation / TOLERANCE[Tier.LOW])


def distance(rows: pd.DataFrame) -> pd.Series[float]:
    """The largest of cost gap, violation and those of the timed answers, infinite where it is not ok."""
    return _worst(rows, rows.cost_gap, rows.violation, rows.timed_gap.fillna(0.0))


def _worst(rows: pd.DataFrame, *parts: pd.Series) -> pd.Series[float]:
    return pd.concat(parts, axis=1).max(axis=1, skipna=False).fillna(math.inf).mask(rows.status != Status.OK, math.inf)


def tainted(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, where a solver lane that was caught cheating at one setting on a problem has that status at all of
    them."""
    cheats = rows.status.where(rows.status.isin([str(status) for status in CHEATS]))
    if cheats.isna().all():
        return rows
    said = cheats.groupby([rows[name] for name in MEASURED]).transform("first")
    return rows.assign(status=rows.status.mask((rows.status == Status.OK) & said.notna(), said))


def measured(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows but those not run of what another repeat has measured: a ladder ends by the clock, and nothing is known
    against the answer."""
    skipped = rows.status == Status.NOT_RUN
    if not skipped.any():
        return rows
    known = (~skipped).groupby([rows[name] for name in (*MEASURED, "setting", "start")]).transform("any")
    return rows[~(skipped & known)]


def right(rows: pd.DataFrame, tier: Tier) -> pd.Series[bool]:
    """Whether each answer is as exact as a tier asks."""
    return error(rows, tier) <= 1.0


def worst(values: pd.Series) -> float:
    """The largest of several; NaN where any is, so that to fail most of them does not look like exactness."""
    return float(values.max(skipna=False))


def least_good(statuses: pd.Series) -> str:
    """Ok where all are, else the first that is not."""
    return next((str(status) for status in statuses if status != Status.OK), str(Status.OK))
