"""Who reaches which accuracy how fast: the short table of a one-shot race, over all problem sets together.

A row is a solver lane on data in the first scaling, started cold; for each target it has the median over the problems of update and
solve at the rung that was found for the target, and on how many problems the answer reached it. Rows are ordered by the most exact
cost gap that a solver reaches on every problem, 1e-9 counting most, and then by the time for that. The paper's method comes first,
at its own pace of one step a sampling period, whatever a step costs to compute.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from bench.races import null_solver
from bench.races.calibration import SEARCHED, TARGETS
from bench.races.metrics import worst
from bench.report.report import Table
from bench.report.words import MARK, OURS_NOTE, gap, marked, number
from bench.timing.schedule import PERIOD_US
from solvers import Lane, Status, Tier

PAPER = "projected_difference"
LETTERS = 11
"""Of a cell in a terminal."""
PACE = f"paper's method{MARK}"
ORDER = (Tier.HIGH, Tier.MID, Tier.LOW)
ASKED = {Tier.LOW: "1e-3", Tier.MID: "1e-6", Tier.HIGH: "1e-9", Tier.EXACT: "1e-12", Tier.STAGE: "stage"}
"""How a target is called on the first screen."""


@dataclass(frozen=True)
class Result:
    """What a solver lane took at one tier, and on how many problems its answer reached it."""

    us: float
    """Median over the problems, NaN without any answer."""
    right: int
    problems: int
    worst_gap: float

    @property
    def reached(self) -> bool:
        """Whether it did on all problems."""
        return self.right == self.problems


@dataclass(frozen=True)
class Line:
    """A solver in a lane, under the name that it has in tables."""

    name: str
    solver: str
    lane: str
    results: dict[Tier, Result]

    @property
    def place(self) -> tuple[float, ...]:
        """The smaller, the better."""
        best = next((i for i, tier in enumerate(ORDER) if tier in self.results and self.results[tier].reached), len(ORDER))
        at = next((self.results[tier] for tier in (*ORDER[best:], *Tier) if tier in self.results), None)
        return self.name != PACE, best, math.inf if at is None or math.isnan(at.us) else at.us


def ranking(rows: pd.DataFrame) -> list[Line]:
    """The lines of the table in their order."""
    rows = rows[(rows.scaling == scaling_of(rows)) & (rows.start == "cold") & (rows.solver != null_solver.ENTRY.name) & (rows.tier != Tier.RUNG)]
    rows = rows.assign(right=rows.status == Status.OK, us=rows.update_us + rows.solve_us_p50)
    pace = of_paper(rows)
    rows = pd.concat([pace.assign(name=PACE, us=pace.periods * PERIOD_US), rows.assign(name=rows.solver.map(marked))])
    lines: dict[tuple[str, str, str], dict[Tier, Result]] = {}
    for names, part in rows.groupby(["name", "solver", "lane", "tier"]):
        name, solver, lane, tier = map(str, names)
        lines.setdefault((name, solver, lane), {})[Tier(tier)] = Result(
            float(part.us.median()), int(part.right.sum()), len(part), worst(part.cost_gap))
    return sorted((Line(*who, results) for who, results in lines.items()), key=lambda line: line.place)


def scaling_of(rows: pd.DataFrame) -> str:
    """The scaling of the first screen."""
    return "scaled" if (rows.scaling == "scaled").any() or rows.empty else str(rows.scaling.iloc[0])


def lane_of_paper(rows: pd.DataFrame) -> str:
    """The lane whose steps stand for the paper's method."""
    return str(Lane.KERNEL if ((rows.solver == PAPER) & (rows.lane == Lane.KERNEL)).any() else Lane.DIRECT)


def of_paper(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of the paper's method in its lane on the problems that it takes."""
    return rows[(rows.solver == PAPER) & (rows.lane == lane_of_paper(rows)) & (rows.status != Status.UNSUPPORTED)]


def short_table(lines: Sequence[Line], note: str, terminal: bool = False) -> Table:
    """The ranking as text: a terminal has room for the lanes with a ladder only, and for cells of eleven letters."""
    targets = [tier for tier in TARGETS if any(tier in line.results for line in lines)]
    if terminal:
        lines = [line for line in lines if line.lane in SEARCHED] or lines
    cell = _narrow if terminal else _wide
    rows = [[line.name, line.lane, *(cell(line.results[tier]) if tier in line.results else "–" for tier in targets),
             gap(line.results[Tier.DEFAULT].worst_gap) if Tier.DEFAULT in line.results else "–"] for line in lines]
    headings = ["solver", "lane", *(f"to {ASKED[tier]}" if tier is not Tier.STAGE else "stage" for tier in targets),
                "default" if terminal else "default gap"]
    missed = "✗2/3" if terminal else "missed 2/3"
    return Table("Time to accuracy", headings, rows, 2, ("lane",), f"{note} Times: µs of update and solve, then sampling periods of "
                 f"{PERIOD_US:g} µs. {missed}: right on 2 of 3 problems only. {OURS_NOTE}")


def _wide(cell: Result) -> str:
    us = number(cell.us) if cell.us < 1e6 else f"{cell.us:.1e}".replace("e+0", "e")
    time = "no answer" if math.isnan(cell.us) else f"{us} ({_periods(cell.us)})"
    return time if cell.reached else f"missed {cell.right}/{cell.problems}:\n{time}"


def _narrow(cell: Result) -> str:
    us = cell.us
    time = ("–" if math.isnan(us) else f"{us / 1e6:.2g}s" if us >= 1e6 else f"{us / 1e3:.0f}ms" if us >= 1e4 else number(us) if us >= 1.0
            else f"{us:.2f}")
    if cell.reached:
        return f"{time} {_periods(us):>5}"
    missed = f"✗{cell.right}/{cell.problems}"
    return f"{missed} {time}" if len(missed) + len(time) < LETTERS else missed


def _periods(us: float) -> str:
    """Sampling periods in at most five letters, as far as there are fewer than a hundred thousand."""
    count = us / PERIOD_US
    return f"{count:.3f}" if count < 0.01 else f"{count:.2f}" if count < 1.0 else f"{count:.1f}" if count < 10.0 else f"{count:.0f}"


def yardstick(foreign: bool, own: bool) -> str:
    """What a cost gap is divided by, and why."""
    ours = "V* + c, the squared error of the best model: 1e-3 is 0.1 % more squared error than need be"
    theirs = "max(½ x*ᵀPx*, |qᵀx*|) where the cost of a program from a file is no sum of squares"
    over = "; over ".join(text for text, there in ((ours, own), (theirs, foreign)) if there)
    return f"Cost gap: the cost above the proven optimum V*, over {over}."
