"""What an anytime race says and shows."""

from __future__ import annotations

import pandas as pd

from bench.races.anytime import charts, figures, plot_data
from bench.races.anytime.race import ANYTIME, BUDGETS
from bench.report.report import Figure, Report, Table, what_went_wrong
from bench.report.words import OURS_NOTE, gap, marked
from bench.store import Run
from bench.timing.schedule import PERIOD_US

WHO = ("solver", "lane", "pace")
SHORT = (1, 10, 100, 1_000, 15_200)
"""Budgets of the short table."""
DEFINITIONS = (
    "Solvers with a limit of iterations ran with growing limits, from a cold start each time; the others have the one point of their full "
    "solve. The gap within a budget is the best of what is there by then; –: nothing yet.",
    "The gap is exact, of the feasible point nearest to the iterate; the median over the problems of a set and size. summary.csv has the "
    "worst beside it.",
    f"Time is the median of update plus the median of solve, in sampling periods of {PERIOD_US:g} µs. As fits: as many iterations as the time "
    "holds. One step a sample: the paper's pace, where a step takes a period whatever it costs to compute.",
    "An update of projected_difference and accelerated_projection finds the largest eigenvalue anew and is called from Python.",
    OURS_NOTE)


def report(run: Run) -> Report:
    """Everything from the points of a finished run."""
    rows = run.rows(ANYTIME)
    summary = figures.summary(rows)
    wide = figures.wide(summary)
    first = figures.of_first_screen(wide)
    by_set = wide.groupby(["problem_set", "d", "scaling"], sort=False)
    which = "" if first.empty else f", {first.problem_set[0]}, {first.d[0]} unknowns, {first.scaling[0]} data"
    return Report(
        figures.verdict(first),
        _table(f"Accuracy within so many sampling periods{which}", first, ("solver", "lane", "pace"), SHORT,
               f"Median over the problems of the cost gap, (V − V*)/(V* + c), within so many periods of {PERIOD_US:g} µs. {OURS_NOTE}"),
        summary, definitions=DEFINITIONS,
        notes=[f"{problem_set}, {d} unknowns, {scaling} data: {' '.join(figures.verdict(part))}" for (problem_set, d, scaling), part in by_set]
        if len(by_set) > 1 else [],
        tables=[*(_table(f"{problem_set}, {d} unknowns, {scaling} data", part, WHO, BUDGETS) for (problem_set, d, scaling), part in by_set),
                what_went_wrong(rows, ("solver", "lane", "scaling", "problem", "status", "message"), ("solver", "lane", "message"))],
        figures=[Figure.of("anytime", "Accuracy within sampling periods",
                           "The best cost gap that is there within so many sampling periods, median over the problems; lower and further left is "
                           "better. Gaps below 1e-17 are drawn at that.", plot_data.anytime(rows), charts.anytime)])


def _table(title: str, part: pd.DataFrame, who: tuple[str, ...], budgets: tuple[int, ...], note: str = "") -> Table:
    rows = [[marked(line.solver), *(str(line[name]) for name in who[1:]), *(gap(line[budget]) for budget in budgets)] for _, line in part.iterrows()]
    return Table(title, (*who, *map(str, budgets)), rows, len(who), ("lane", "pace"), note)
