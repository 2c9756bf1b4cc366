"""Every figure of an anytime race, computed here once and rendered elsewhere.

A *curve* belongs to one solver in one lane with one pace: ``as fits`` takes as many iterations as fit into the
time; ``one step a sample`` is the paper's, where a step takes a period. The gap within a budget is the smallest of the points
that are there by then, none (infinity) before the first; over the problems of a set and a size the median and the worst
are shown, since one mean over sizes hides the order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from bench.races.anytime.race import BUDGETS
from bench.report.words import gap, marked, solver_lanes

GROUP = ["problem_set", "d", "scaling", "solver", "lane", "pace"]
FITS, PAPER = "as fits", "one step a sample"
RIGHT = 1e-9
PAPERS = "projected_difference"


def curves(rows: pd.DataFrame) -> pd.DataFrame:
    """The points with their pace; those of methods that count steps once more at one step a sample.

    Of several processes a point has the median time and the worst gap.
    """
    same = [*(name for name in GROUP if name != "pace"), "problem", "limit", "iteration_setting"]
    points = rows[rows.cost_gap.notna()].groupby(same, sort=False).agg(
        periods=("periods", "median"), cost_gap=("cost_gap", "max")).reset_index()
    stepping = points[(points.iteration_setting == "steps") & (points.lane == "kernel")]
    return pd.concat([points.assign(pace=FITS), stepping.assign(pace=PAPER, periods=stepping.limit.astype(float))],
                     ignore_index=True)


def within(rows: pd.DataFrame) -> pd.DataFrame:
    """The gap within each budget by curve and problem: columns of GROUP, problem, budget, gap."""
    found: list[dict[str, Any]] = []
    for names, part in curves(rows).groupby([*GROUP, "problem"], sort=False):
        periods, gaps = part.periods.to_numpy(), part.cost_gap.to_numpy()
        for budget in BUDGETS:
            there = gaps[periods <= budget]
            found.append({**dict(zip([*GROUP, "problem"], names, strict=True)), "budget": budget,
                          "gap": float(there.min()) if there.size else math.inf})
    return pd.DataFrame(found, columns=[*GROUP, "problem", "budget", "gap"])


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Median and worst gap over the problems, one row a curve and budget; a problem without an answer counts as infinite."""
    asked = rows.groupby(["problem_set", "d", "scaling"]).problem.nunique().rename("asked").reset_index()
    table = within(rows).merge(asked, on=["problem_set", "d", "scaling"])
    if table.empty:
        return pd.DataFrame(columns=[*GROUP, "budget", "problems", "median_gap", "worst_gap"])
    lines = []
    for names, part in table.groupby([*GROUP, "budget"], sort=False):
        wanted = int(part.asked.iloc[0])
        gaps = np.concatenate([part.gap.to_numpy(), np.full(wanted - len(part), np.inf)])
        lines.append({**dict(zip([*GROUP, "budget"], names, strict=True)), "problems": wanted,
                      "median_gap": float(np.quantile(gaps, 0.5, method="higher")), "worst_gap": float(gaps.max())})
    return pd.DataFrame(lines)


def wide(table: pd.DataFrame, value: str = "median_gap") -> pd.DataFrame:
    """One row a curve, one column a budget; those that are exact first come first."""
    if table.empty:
        return pd.DataFrame(columns=[*GROUP, *BUDGETS])
    spread = table.pivot_table(index=GROUP, columns="budget", values=value, aggfunc="first", sort=False).reset_index()
    order: list[Any] = ["problem_set", "d", "scaling", *BUDGETS]
    return spread.sort_values(order, ascending=[True, True, False, *[True] * len(BUDGETS)], ignore_index=True)


def of_first_screen(table: pd.DataFrame) -> pd.DataFrame:
    """Of a wide table, the first set and size on scaled data, each curve, the paper's pace first."""
    if table.empty:
        return table
    first = table.sort_values("scaling", ascending=False, kind="stable").iloc[0]
    part = table[(table[["problem_set", "d", "scaling"]] == first[["problem_set", "d", "scaling"]]).all(axis=1)]
    part = part.drop_duplicates(["solver", "lane", "pace"])
    paper = (part.solver == PAPERS) & (part.pace == PAPER)
    return pd.concat([part[paper], part[~paper]], ignore_index=True)


def verdict(part: pd.DataFrame) -> list[str]:
    """Of one set, size and scaling: who is exact within one period, what the paper's steps reach, and when they would if more fitted."""
    if part.empty:
        return ["No solver gave an answer."]
    fits = part[part.pace == FITS]
    exact = fits[fits[1] <= RIGHT]
    sentence = f"Within one sampling period {solver_lanes(len(exact), len(fits), 'reach')} a cost gap of {RIGHT:g} on the median problem"
    if len(exact):
        sentence += f"; the closest is {marked(exact.iloc[0].solver)} ({exact.iloc[0].lane}) with {exact.iloc[0][1]:.1e}"
    return [sentence + ".", *_paper(part)]


def _paper(part: pd.DataFrame) -> Iterator[str]:
    """The paper's pace beside the same method with as many steps as fit."""
    method = part[(part.solver == PAPERS) & (part.lane == "kernel")]
    paper, fits = method[method.pace == PAPER], method[method.pace == FITS]
    if len(paper) and len(fits):
        reached, begun = float(paper.iloc[0][BUDGETS[-1]]), float(paper.iloc[0][BUDGETS[0]])
        sooner = next((budget for budget in BUDGETS if fits.iloc[0][budget] <= reached), None)
        yield (f"The paper's method, one step a sample, begins at {gap(begun)} and is at {gap(reached)} after {BUDGETS[-1]} periods"
               + ("." if sooner is None else f"; with as many steps as fit into the time it is there within {sooner}."))
