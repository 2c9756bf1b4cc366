"""Accuracy of the answer that a solver has within k sampling periods.

    gap of a solver lane within k on a problem = smallest cost gap of its settings and iteration limits that take at
    most k sampling periods of the problem,

infinite without an answer. Tables show the median and the largest gap over the problems, in the first scaling and from
a cold start. The paper's method appears twice: with as many steps as fit into the time, and at its own pace of one step
per period, whatever a step costs.
"""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from bench.derived.measurements import FLOOR, Measurements
from bench.derived.pictures import ranked
from bench.derived.ranking import PACE, with_pace
from bench.derived.tiers import PROBLEM, TOLERANCE
from bench.messages.task import PAPER, Status, Tier
from bench.report.report import LEAST_GAP, Table
from bench.report.words import OURS_NOTE, gap, solver_lanes

BUDGETS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 15_200)
"""Sampling periods; the last one is the paper's 1.9 s."""
SHORT = (1, 10, 100, 1_000, 15_200)
"""Budgets in the table."""
LINE = ["name", "solver", "lane"]


def anytime(measurements: Measurements) -> pd.DataFrame:
    """One row per solver lane (LINE) and ``budget``, with ``median_gap`` and ``worst_gap`` over ``problems``."""
    rows = measurements.cold(measurements.rows[measurements.rows.solver != FLOOR])
    rows = with_pace(rows.assign(cost_gap=rows.cost_gap.where(rows.status == Status.OK).fillna(math.inf)))
    keys = [rows[name] for name in [*LINE, *PROBLEM]]
    parts = []
    for budget in BUDGETS:
        gaps = rows.cost_gap.where(rows.answer_us <= budget * rows.period_us, math.inf).groupby(keys).min()
        # the upper median, since a mean with an infinite gap is useless
        lines = gaps.groupby(level=LINE).agg(
            problems="size", median_gap=lambda gaps: np.sort(gaps)[gaps.size // 2], worst_gap="max"
        )
        parts.append(lines.reset_index().assign(budget=budget))
    return pd.concat(parts, ignore_index=True)


def drawn(table: pd.DataFrame) -> pd.DataFrame:
    """The lines of the picture: the paper's pace, then the others from accurate to inaccurate; ``drawn`` is the gap on
    the axis."""
    place = by_budget(table)[LINE].reset_index(names="place")
    found = table[np.isfinite(table.median_gap)].merge(place, on=LINE)
    named = found["name"].where(found["name"] == PACE, found["name"] + " (" + found.lane + ")")
    lines = found.assign(name=named, view="", drawn=np.maximum(found.median_gap, LEAST_GAP))
    return ranked(lines, lines.place).drop(columns=["view", "place"])


def by_budget(table: pd.DataFrame) -> pd.DataFrame:
    """One row per solver lane, one column per budget: the paper's pace, then the others from accurate to inaccurate."""
    wide = table.pivot_table(index=LINE, columns="budget", values="median_gap", sort=False).reset_index()
    accurate_first = wide.sort_values(wide.columns.drop(LINE).tolist(), kind="stable")
    return accurate_first.sort_values("name", key=lambda names: names != PACE, kind="stable", ignore_index=True)


def accuracy_table(table: pd.DataFrame) -> Table:
    """Table of the median gaps within the budgets SHORT."""
    rows = [
        [line["name"], line["lane"], *(gap(line[budget]) for budget in SHORT)]
        for line in by_budget(table).to_dict("records")
    ]
    return Table(
        "Accuracy within so many sampling periods",
        ("solver", "lane", *map(str, SHORT)),
        rows,
        2,
        ("lane",),
        f"Median over the problems of the best cost gap within so many periods of the problem's own data. –: "
        f"nothing yet. {OURS_NOTE}",
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """Solvers that are accurate within a period, the accuracy of the paper's steps, and the time that it takes without
    waiting for samples."""
    wide = by_budget(table)
    others, tolerance = wide[wide.name != PACE], TOLERANCE[Tier.HIGH]
    if others.empty:
        yield "No solver gave an answer."
        return
    reach = others[others[1] <= tolerance]
    closest = (
        f"; the closest is {reach.name.iloc[0]} ({reach.lane.iloc[0]}) with {reach[1].iloc[0]:.1e}"
        if len(reach)
        else ""
    )
    yield (
        f"Within one sampling period {solver_lanes(len(reach), len(others), 'reach')} a cost gap of {tolerance:g} on "
        f"the median problem{closest}."
    )
    if len(others) < len(wide):
        paced = wide[wide.name == PACE].iloc[0]
        own = others[(others.solver == PAPER) & (others.lane == paced.lane)].iloc[0]
        first = next((paced[budget] for budget in BUDGETS if math.isfinite(paced[budget])), math.inf)
        last = paced[BUDGETS[-1]]
        sooner = next((budget for budget in BUDGETS if own[budget] <= last), None)
        yield (
            f"The paper's method, one step a sample, begins at {gap(first)} and is at {gap(last)} after "
            f"{BUDGETS[-1]} periods"
            + ("." if sooner is None else f"; with as many steps as fit into the time it is there within {sooner}.")
        )
