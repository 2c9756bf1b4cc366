"""Which setting of a solver stands for a tier.

One setting for all problems: the loosest that meets the tier ten times over on every one, else three times, else once. Where none
does, the tier is not reached. The margin is for data that were not measured: answers on fresh data change their verdict in a quarter of
the cases at margins from 1 to 3, and in one of 140 above ten.

How good the choice is on a problem that it has not seen is told by leaving out each problem in turn: the share of them on which the
setting that the others choose is right.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.derived.accuracy import applies, error
from solvers import Tier

TARGETS = (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT, Tier.STAGE)
MARGINS = (10.0, 3.0, 1.0)
FEWEST = 3
"""Problems from which on one can be left out."""
LANE = ["scaling", "solver", "lane"]
PROBLEM = ["problem_set", "problem"]


def tier_settings(rows: pd.DataFrame) -> pd.DataFrame:
    """One row a scaling, solver lane and tier: LANE, ``tier``, ``setting`` ("" where it is not reached), ``rung``, ``margin``,
    ``problems``, ``right`` (on how many the setting is right, or where none is right on all, the one that is on most),
    ``furthest`` (that setting) and ``left_out``, the share that stays right with the judged problem left out.
    """
    cold = rows[(rows.start == "cold") & (rows.rung >= 0)]
    found = [{**dict(zip(LANE, who, strict=True)), "tier": str(tier), **_chosen(part[applies(part, tier)], tier)}
             for who, part in cold.groupby(LANE, sort=False) for tier in TARGETS if applies(part, tier).any()]
    return pd.DataFrame(found, columns=[*LANE, "tier", "setting", "rung", "margin", "problems", "right", "furthest", "left_out"])


def _chosen(rows: pd.DataFrame, tier: Tier) -> dict[str, object]:
    errors = rows.assign(error=error(rows, tier)).pivot_table(
        index=PROBLEM, columns=["rung", "setting"], values="error", aggfunc="max").sort_index(axis=1)
    wide = errors.to_numpy(dtype=np.float64, na_value=math.inf)
    at = choice(wide)
    counts = (wide <= 1.0).sum(axis=0)
    furthest = int(np.argmax(counts)) if at is None else at
    rung, setting = errors.columns[furthest]
    reached = at is not None
    return {"setting": setting if reached else "", "rung": rung if reached else -1, "margin": margin(wide[:, furthest]) if reached else math.nan,
            "problems": len(wide), "right": int(counts[furthest]), "furthest": setting,
            "left_out": left_out(wide) if reached and len(wide) >= FEWEST else math.nan}


def choice(errors: NDArray[np.float64]) -> int | None:
    """The setting of a table of errors (problems, settings from loose to tight), or None.

    Examples
    --------
    >>> choice(np.array([[0.5, 0.05], [0.2, 0.01]]))
    1
    >>> choice(np.array([[0.5, 0.4], [0.2, 2.0]]))
    0
    """
    worst = errors.max(axis=0)
    return next((int(met.argmax()) for each in MARGINS if (met := each * worst <= 1.0).any()), None)


def margin(errors: NDArray[np.float64]) -> float:
    """The largest of MARGINS that all the errors leave."""
    return next(each for each in MARGINS if each * errors.max() <= 1.0)


def left_out(errors: NDArray[np.float64]) -> float:
    """The share of the problems on which the setting that the others choose is right."""
    kept = [choice(np.delete(errors, i, axis=0)) for i in range(len(errors))]
    return float(np.mean([at is not None and errors[i, at] <= 1.0 for i, at in enumerate(kept)]))
