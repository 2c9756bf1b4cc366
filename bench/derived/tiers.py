"""Whether an answer reaches a tier, from its row of the table alone, and the setting of a solver at each tier.

    error = max(cost gap, violation, worst of the timed answers) / tolerance
    error = max(stage excess / 0.1, violation / 1e-3), timed answers included  for the tier `stage`

An answer is right if error ≤ 1, and right with margin m if m · error ≤ 1. A library's defaults have the tolerance of
`low`.

The setting of a tier is one for all problems: the loosest that meets the tier with margin ten on every problem, else
with margin three, else with margin one. Without such a setting, the tier is not reached. The margin allows for data
that were not measured: on fresh data, answers with margins from 1 to 3 change between right and wrong in a quarter of
the cases, and above ten in one of 140.

Leaving out each problem in turn shows how the choice generalises: the share of problems on which the setting chosen on
the others is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.messages.task import Status, Tier

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
    return _worst(rows, *first, *(column.fillna(0.0) for column in timed)).clip(lower=0.0)


def distance(rows: pd.DataFrame) -> pd.Series[float]:
    """Largest of cost gap, violation and the timed answers' gap; infinite if the status is not ok."""
    return _worst(rows, rows.cost_gap, rows.violation, rows.timed_gap.fillna(0.0))


def _worst(rows: pd.DataFrame, *columns: pd.Series) -> pd.Series[float]:
    return (
        pd.concat(columns, axis=1)
        .max(axis=1, skipna=False)
        .fillna(math.inf)
        .mask(rows.status != Status.ANSWERED, math.inf)
    )


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


def failed(rows: pd.DataFrame, stated: Mapping[str, float]) -> str:
    """A sentence with those solver lanes of ``stated``, the largest error of each, that fail or err by more, or "".

    A lane fails if the ``error`` of a row is infinite, and errs by that of its most accurate setting on its worst
    problem.
    """
    failures, named = [], supported(rows).assign(name=rows.solver + " (" + rows.lane + ")")
    for name, most in stated.items():
        here = named[named["name"] == name]
        wrong, least = here[np.isinf(here.error) & (here.status != Status.NOT_RUN)], here.groupby("setting").error.max()
        if len(wrong) or not least.min() <= most:
            failures.append(
                f"{name} fails on {wrong.problem.nunique()} of {here.problem.nunique()} problems, first on "
                f"{wrong.problem.iloc[0]}: {wrong.message.iloc[0] or 'an answer is not finite'}"
                if len(wrong)
                else f"{name} has an error of {least.min():.1e}, above the {most:.0e} that it states"
                if len(here)
                else f"{name} accepts no problem"
            )
    return f"Wrong: {'; '.join(failures)}." if failures else ""


TARGETS = (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT, Tier.STAGE)
MARGINS = (10.0, 3.0, 1.0)
FEWEST = 3
"""Smallest number of problems for leave-one-out validation."""
LANE = ["scaling", "solver", "lane"]
CHOSEN = ["setting", "rung", "margin", "problems", "right", "worst", "furthest", "left_out"]
PROBLEM = ["problem_set", "problem"]


def tier_settings(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per LANE and ``tier``, with CHOSEN."""
    rows = supported(measured(rows))
    lines = []
    for tier in TARGETS:
        applicable = rows[applies(rows, tier)]
        chosen = chosen_settings(applicable.assign(error=error(applicable, tier)))
        lines += [{**line, "tier": str(tier)} for line in chosen]
    return pd.DataFrame(lines, columns=[*LANE, "tier", *CHOSEN])


def chosen_settings(rows: pd.DataFrame, within: float = 1.0) -> Iterator[dict[str, Any]]:
    """For each LANE the chosen ``setting`` of its ladder from a cold start, for rows with an ``error`` of at most
    ``within``.

    ``setting`` is "" if no setting is right on every problem; ``rung`` and ``margin`` belong to it. ``problems`` is the
    number of problems, ``furthest`` the chosen setting or the one that is right on most of them, ``right`` on how many
    that one is, ``worst`` the problem of its largest error ``largest``, and ``left_out`` the share that stays right
    with the judged problem left out.
    """
    cold = rows[(rows.start == "cold") & (rows.rung >= 0)]
    for key, lane in cold.assign(number=cold.groupby(PROBLEM).ngroup()).groupby(LANE, sort=False):
        errors, rungs = by_problem(lane)
        names = dict(zip(lane.rung, lane.setting, strict=True))
        at, counts = choice(errors, within), (errors <= within).sum(axis=0)
        furthest, reached = int(np.argmax(counts)) if at is None else at, at is not None
        worst = np.unique(lane.number)[int(np.argmax(errors[:, furthest]))]
        yield {
            **dict(zip(LANE, cast(tuple[str, ...], key), strict=True)),
            "setting": names[rungs[furthest]] if reached else "",
            "rung": rungs[furthest] if reached else -1,
            "margin": max(each for each in MARGINS if each * errors[:, furthest].max() <= within)
            if reached
            else math.nan,
            "problems": len(errors),
            "right": int(counts[furthest]),
            "worst": lane.problem[lane.number == worst].iloc[0],
            "largest": float(errors[:, furthest].max()),
            "furthest": names[rungs[furthest]],
            "left_out": leave_one_out(errors, within) if reached and len(errors) >= FEWEST else math.nan,
        }


def by_problem(rows: pd.DataFrame) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The largest errors of a solver lane over repeats and hosts as an array (problems, settings), infinite if not
    measured, and the rungs of the settings."""
    problems, i = np.unique(rows.number, return_inverse=True)
    rungs, j = np.unique(rows.rung, return_inverse=True)
    worst = np.full((problems.size, rungs.size), -math.inf)
    np.maximum.at(worst, (i, j), rows.error)
    return np.where(worst < 0.0, math.inf, worst), rungs


def choice(errors: NDArray[np.float64], within: float = 1.0) -> int | None:
    """Index of the chosen setting for errors (problems, settings from loose to tight), or None if none is ``within``.

    Examples
    --------
    >>> choice(np.array([[0.5, 0.05], [0.2, 0.01]]))
    1
    >>> choice(np.array([[0.5, 0.4], [0.2, 2.0]]))
    0
    """
    worst = errors.max(axis=0)
    return next((int(met.argmax()) for factor in MARGINS if (met := factor * worst <= within).any()), None)


def leave_one_out(errors: NDArray[np.float64], within: float = 1.0) -> float:
    """Share of the problems on which the setting chosen on the other problems is right."""
    chosen = [choice(np.delete(errors, i, axis=0), within) for i in range(len(errors))]
    return float(np.mean([at is not None and errors[i, at] <= within for i, at in enumerate(chosen)]))
