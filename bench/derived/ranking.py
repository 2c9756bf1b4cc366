"""Who reaches which accuracy how fast: the short table of a one-shot race, over all problem sets together.

A row is a solver lane on data in the first scaling, started cold; for each tier it has the median over the problems of
update and solve at the one setting that stands for it. Rows are ordered by the most exact cost gap that a solver
reaches, 1e-9 counting most, and then by the time for that. The paper's method comes first, at its own pace of one step
a sampling period, whatever a step costs to compute.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from bench.derived.accuracy import worst
from bench.derived.measurements import Measurements
from bench.derived.tier_settings import TARGETS
from bench.report.report import Table
from bench.report.words import MARK, OURS_NOTE, gap, marked, number
from bench.timing.schedule import PERIOD_US
from solvers import Lane, Status, Tier
from solvers.registry import FAMILIES

PAPER = "projected_difference"
PACE = f"paper's method{MARK}"
ORDER = (Tier.HIGH, Tier.MID, Tier.LOW)
ASKED = {Tier.LOW: "1e-3", Tier.MID: "1e-6", Tier.HIGH: "1e-9", Tier.EXACT: "1e-12", Tier.STAGE: "stage"}
"""How a tier is called on the first screen."""


@dataclass(frozen=True)
class Result:
    """What a solver lane took at one tier; of a tier that it does not reach, on how many problems the furthest setting
    is right."""

    us: float
    """Median over the problems, NaN where it is not reached."""
    right: int
    problems: int
    setting: str = ""
    left_out: float = math.nan
    """Share of the problems on which the setting that the others choose is right."""

    @property
    def reached(self) -> bool:
        """Whether one setting does on all problems."""
        return not math.isnan(self.us)


@dataclass(frozen=True)
class Line:
    """A solver in a lane, under the name that it has in tables."""

    name: str
    solver: str
    lane: str
    results: dict[Tier, Result]
    default_gap: float
    """The worst of its defaults; NaN where it has no answer."""

    @property
    def place(self) -> tuple[float, ...]:
        """The smaller, the better."""
        best = next(
            (i for i, tier in enumerate(ORDER) if tier in self.results and self.results[tier].reached), len(ORDER)
        )
        at = self.results[ORDER[best]].us if best < len(ORDER) else math.inf
        return self.name != PACE, best, at


def ranking(found: Measurements) -> list[Line]:
    """The lines of the table in their order."""
    field = found.field[(found.field.scaling == found.scaling) & (found.field.start == "cold")]
    rows = found.tiers[(found.tiers.scaling == found.scaling) & (found.tiers.start == "cold")]
    rows = rows.assign(name=rows.solver.map(marked))
    pace = of_paper(rows)
    us = (
        pd.concat([rows, pace.assign(name=PACE, total_us=pace.periods * PERIOD_US)])
        .groupby(["name", "lane", "tier"])
        .total_us.median()
    )
    gaps = rows[rows.is_default].drop_duplicates("task").groupby(["name", "lane"]).cost_gap.agg(worst)
    lines = {}
    for row in field.drop_duplicates(["solver", "lane"]).to_dict("records"):
        solver, lane = row["solver"], row["lane"]
        paced = [PACE] if len(of_paper(field)) and solver == PAPER and lane == lane_of_paper(field) else []
        for name in (marked(solver), *paced):
            lines[name, lane] = Line(name, solver, lane, {}, float(gaps.get((marked(solver), lane), math.nan)))
    for chosen in found.settings[found.settings.scaling == found.scaling].to_dict("records"):
        for name in (marked(chosen["solver"]), PACE):
            if (line := lines.get((name, chosen["lane"]))) is not None and line.solver == chosen["solver"]:
                time = float(us.get((name, chosen["lane"], chosen["tier"]), math.nan))
                line.results[Tier(chosen["tier"])] = Result(
                    time, chosen["right"], chosen["problems"], chosen["setting"], chosen["left_out"]
                )
    return sorted(lines.values(), key=lambda line: line.place)


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
        lines = [line for line in lines if line.lane not in FAMILIES] or lines
    rows = [
        [line.name, line.lane, *_cells([line.results.get(tier) for tier in targets], terminal), gap(line.default_gap)]
        for line in lines
    ]
    headings = [
        "solver",
        "lane",
        *(f"to {ASKED[tier]}" if tier is not Tier.STAGE else "stage" for tier in targets),
        "default" if terminal else "default gap",
    ]
    missed = "✗2/3" if terminal else "not reached (2/3)"
    return Table(
        "Time to accuracy",
        headings,
        rows,
        2,
        ("lane",),
        f"{note} Times: µs of update and solve, then sampling periods of "
        f"{PERIOD_US:g} µs, at the loosest setting that is right on every problem. {missed}: there is none; "
        f"the best is right on 2 of 3. = is the same setting as to its left. {OURS_NOTE}",
    )


def _cells(results: Sequence[Result | None], terminal: bool) -> list[str]:
    """The cells of a line; what the same setting reaches once more is not printed again."""
    found: list[str] = []
    before = ""
    for result in results:
        same = result is not None and result.reached and result.setting == before
        found.append("–" if result is None else "=" if same else (_narrow if terminal else _wide)(result))
        before = result.setting if result is not None and result.reached else ""
    return found


def _wide(cell: Result) -> str:
    us = number(cell.us) if cell.us < 1e6 else f"{cell.us:.1e}".replace("e+0", "e")
    return f"{us} ({_periods(cell.us)})" if cell.reached else f"not reached ({cell.right}/{cell.problems})"


def _narrow(cell: Result) -> str:
    us = cell.us
    if not cell.reached:
        return f"✗{cell.right}/{cell.problems}"
    time = (
        f"{us / 1e6:.2g}s"
        if us >= 1e6
        else f"{us / 1e3:.0f}ms"
        if us >= 1e4
        else number(us)
        if us >= 1.0
        else f"{us:.2f}"
    )
    return f"{time} {_periods(us):>5}"


def _periods(us: float) -> str:
    """Sampling periods in at most five letters, as far as there are fewer than a hundred thousand."""
    count = us / PERIOD_US
    return (
        f"{count:.3f}"
        if count < 0.01
        else f"{count:.2f}"
        if count < 1.0
        else f"{count:.1f}"
        if count < 10.0
        else f"{count:.0f}"
    )


def yardstick(foreign: bool, own: bool) -> str:
    """What a cost gap is divided by, and why."""
    ours = "V* + c, the squared error of the best model: 1e-3 is 0.1 % more squared error than need be"
    theirs = "max(½ x*ᵀPx*, |qᵀx*|) where the cost of a program from a file is not a sum of squares"
    over = "; over ".join(text for text, there in ((ours, own), (theirs, foreign)) if there)
    return f"Cost gap: the cost above the proven optimum V*, over {over}."
