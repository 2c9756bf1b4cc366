"""The setting of a solver at each tier.

It is one setting for all problems: the loosest that meets the tier with margin ten on every problem, else with margin
three, else with margin one. Without such a setting, the tier is not reached. The margin allows for data that were not
measured: on fresh data, answers with margins from 1 to 3 change between right and wrong in a quarter of the cases, and
above ten in one of 140.

Leaving out each problem in turn shows how the choice generalises: the share of problems on which the setting chosen on
the others is right.
"""

import math
from typing import cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.derived.accuracy import applies, error, measured, supported
from bench.messages.verdict import Tier

TARGETS = (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT, Tier.STAGE)
MARGINS = (10.0, 3.0, 1.0)
FEWEST = 3
"""Smallest number of problems for leave-one-out validation."""
LANE = ["scaling", "solver", "lane"]
PROBLEM = ["problem_set", "problem"]


def tier_settings(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per LANE and ``tier``, with the chosen ``setting`` ("" if the tier is not reached), its ``rung`` and
    ``margin``, the number of ``problems``, ``furthest``, the chosen setting or the one that is right on most problems,
    ``right``, on how many that one is, ``worst``, the problem of its largest error, and ``left_out``, the share that
    stays right with the judged problem left out.
    """
    rows = supported(measured(rows))
    cold = rows[(rows.start == "cold") & (rows.rung >= 0)]
    cold = cold.assign(number=cold.groupby(PROBLEM).ngroup())
    lines = []
    for tier in TARGETS:
        part = cold[applies(cold, tier)]
        for key, lane in part.assign(error=error(part, tier)).groupby(LANE, sort=False):
            lines.append(
                {**dict(zip(LANE, cast(tuple[str, ...], key), strict=True)), "tier": str(tier), **_chosen(lane)}
            )
    return pd.DataFrame(
        lines,
        columns=[*LANE, "tier", "setting", "rung", "margin", "problems", "right", "worst", "furthest", "left_out"],
    )


def _chosen(rows: pd.DataFrame) -> dict[str, object]:
    errors, rungs = by_problem(rows)
    names = dict(zip(rows.rung, rows.setting, strict=True))
    at = choice(errors)
    counts = (errors <= 1.0).sum(axis=0)
    furthest = int(np.argmax(counts)) if at is None else at
    reached = at is not None
    return {
        "setting": names[rungs[furthest]] if reached else "",
        "rung": rungs[furthest] if reached else -1,
        "margin": margin(errors[:, furthest]) if reached else math.nan,
        "problems": len(errors),
        "right": int(counts[furthest]),
        "worst": rows.problem[rows.number == np.unique(rows.number)[int(np.argmax(errors[:, furthest]))]].iloc[0],
        "furthest": names[rungs[furthest]],
        "left_out": left_out(errors) if reached and len(errors) >= FEWEST else math.nan,
    }


def by_problem(rows: pd.DataFrame) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The largest errors of a solver lane over repeats and hosts as an array (problems, settings), infinite if not
    measured, and the rungs of the settings."""
    problems, i = np.unique(rows.number, return_inverse=True)
    rungs, j = np.unique(rows.rung, return_inverse=True)
    worst = np.full((problems.size, rungs.size), -math.inf)
    np.maximum.at(worst, (i, j), rows.error)
    return np.where(worst < 0.0, math.inf, worst), rungs


def choice(errors: NDArray[np.float64]) -> int | None:
    """Index of the chosen setting for errors (problems, settings from loose to tight), or None.

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
    """The largest of MARGINS that all errors meet."""
    return next(each for each in MARGINS if each * errors.max() <= 1.0)


def left_out(errors: NDArray[np.float64]) -> float:
    """Share of the problems on which the setting chosen on the other problems is right."""
    chosen = [choice(np.delete(errors, i, axis=0)) for i in range(len(errors))]
    return float(np.mean([at is not None and errors[i, at] <= 1.0 for i, at in enumerate(chosen)]))
