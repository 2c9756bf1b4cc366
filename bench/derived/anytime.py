"""How exact an answer is that has to be there after k sampling periods, a pure function of the measurements.

    gap of a solver lane within k on a problem = smallest cost gap of its settings and iteration limits that take at
    most k periods of 125 µs,

infinite where there is none; shown are the median and the worst over the problems, on data in the first scaling, from a
cold start. The paper's method is there twice: with as many steps as fit into the time, and at its own pace of one step
a period, whatever a step costs.
"""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from bench.derived.accuracy import TOLERANCE
from bench.derived.measurements import FLOOR, Measurements
from bench.derived.pictures import ranked
from bench.derived.ranking import PACE, PAPER, lane_of_paper, of_paper
from bench.derived.tier_settings import PROBLEM
from bench.report.plot import LEAST_GAP
from bench.report.report import Table
from bench.report.words import OURS_NOTE, gap, marked, solver_lanes
from bench.timing.schedule import PERIOD_US
from solvers import Status, Tier

BUDGETS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 15_200)
"""Sampling periods; the last are the paper's 1.9 s."""
SHORT = (1, 10, 100, 1_000, 15_200)
"""Of the table."""
LINE = ["name", "solver", "lane"]


def anytime(found: Measurements) -> pd.DataFrame:
    """One row a solver lane (LINE) and ``budget``: ``median_gap``, ``worst_gap`` over ``problems``."""
    rows = found.rows[
        (found.rows.solver != FLOOR) & (found.rows.start == "cold") & (found.rows.scaling == found.scaling)
    ]
    rows = rows.assign(
        name=rows.solver.map(marked),
        at=rows.total_us / PERIOD_US,
        cost_gap=rows.cost_gap.where(rows.status == Status.OK, math.inf).fillna(math.inf),
    )
    pace = of_paper(rows)
    rows = pd.concat([rows, pace.assign(name=PACE, at=pace.periods)], ignore_index=True)
    parts = []
    for budget in BUDGETS:
        gaps = (
            rows.cost_gap.where(rows["at"] <= budget, math.inf)
            .groupby([rows[name] for name in [*LINE, *PROBLEM]])
            .min()
        )
        lines = gaps.groupby(level=LINE).agg(problems="size", median_gap=_median, worst_gap="max")
        parts.append(lines.reset_index().assign(budget=budget))
    return pd.concat(parts, ignore_index=True)


def drawn(table: pd.DataFrame) -> pd.DataFrame:
    """The lines of the picture, the paper's pace and then those that are exact first, with ``drawn``, the gap that is
    drawn."""
    places = {(line["name"], line["lane"]): i for i, line in enumerate(by_budget(table).to_dict("records"))}
    place = pd.Series([places[key] for key in zip(table["name"], table.lane, strict=True)], index=table.index)
    named = table["name"].where(table["name"] == PACE, table["name"] + " (" + table.lane + ")")
    known = table.assign(name=named, view="", drawn=np.maximum(table.median_gap, LEAST_GAP))[
        np.isfinite(table.median_gap)
    ]
    return ranked(known, place[known.index]).drop(columns="view")


def _median(gaps: pd.Series) -> float:
    """The upper of two, since the mean with an infinite gap says nothing."""
    return float(np.sort(gaps)[gaps.size // 2])


def by_budget(table: pd.DataFrame) -> pd.DataFrame:
    """One row a solver lane, one column a budget: the paper's pace, then those that are exact first."""
    wide = table.pivot_table(index=LINE, columns="budget", values="median_gap", sort=False).reset_index()
    places = [*zip(wide.name != PACE, *(wide[budget] for budget in BUDGETS), strict=True)]
    return wide.iloc[sorted(range(len(wide)), key=places.__getitem__)].reset_index(drop=True)


def accuracy_table(table: pd.DataFrame) -> Table:
    """The median gaps within some budgets."""
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
        f"Median over the problems of the best cost gap within so many periods of {PERIOD_US:g} µs. –: "
        f"nothing yet. {OURS_NOTE}",
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """Who is exact within a period, what the paper's steps reach, and when they would if more fitted."""
    wide = by_budget(table)
    fits, least = wide[wide.name != PACE], TOLERANCE[Tier.HIGH]
    if fits.empty:
        yield "No solver gave an answer."
        return
    exact = fits[fits[1] <= least]
    closest = (
        ""
        if exact.empty
        else (f"; the closest is {exact.name.iloc[0]} ({exact.lane.iloc[0]}) with {exact[1].iloc[0]:.1e}")
    )
    yield (
        f"Within one sampling period {solver_lanes(len(exact), len(fits), 'reach')} a cost gap of {least:g} on the "
        f"median problem{closest}."
    )
    paper, own = (
        wide[wide.name == PACE],
        fits[(fits.solver == PAPER) & (fits.lane == lane_of_paper(fits.assign(status=Status.OK)))],
    )
    if len(paper) and len(own):
        reached, begun = (
            paper[BUDGETS[-1]].iloc[0],
            next((g for b in BUDGETS if math.isfinite(g := paper[b].iloc[0])), math.inf),
        )
        sooner = next((budget for budget in BUDGETS if own[budget].iloc[0] <= reached), None)
        yield (
            f"The paper's method, one step a sample, begins at {gap(begun)} and is at {gap(reached)} after "
            f"{BUDGETS[-1]} periods"
            + ("." if sooner is None else f"; with as many steps as fit into the time it is there within {sooner}.")
        )
