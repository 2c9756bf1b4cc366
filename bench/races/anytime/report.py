"""The report of an anytime race: words and tables, Markdown, and what stands on its page."""

from __future__ import annotations

from pathlib import Path

from bench.races.anytime import charts, figures, plot_data
from bench.races.anytime.race import ANYTIME, BUDGETS
from bench.report import markdown, svg
from bench.report.markdown import Report, Table, gap
from bench.report.page import Grid
from bench.report.race_page import Content, figure, grids
from bench.store import Run

WRONG = ("solver", "lane", "tier", "scaling", "problem", "status", "message")
DEFINITIONS = (
    "Solvers with a limit of iterations ran with growing limits, from a cold start each time; the others give the one point of "
    "their full solve. The gap within a budget is the best of what is there by then; –: nothing yet.",
    "The gap is exact, of the feasible point nearest to the iterate, against the certified optimum.",
    "One step a sample: the paper's pace, where a step takes a period whatever it costs.")


def report(run: Run) -> Report:
    """Verdict and tables."""
    rows = run.rows(ANYTIME)
    wide = figures.wide(figures.summary(rows))
    headings = ("solver", "lane", "tier", "pace", *(str(budget) for budget in BUDGETS))
    tables = [Table(f"{problem_set}, d = {d}, {scaling} data: median relative cost gap within so many sampling periods",
                    headings, [[*map(str, line[list(headings[:4])]), *(gap(line[budget]) for budget in BUDGETS)]
                               for _, line in part.iterrows()], 4)
              for (problem_set, d, scaling), part in wide.groupby(["problem_set", "d", "scaling"], sort=False)]
    return Report(figures.verdict(rows), tables)


def write(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and ``anytime.svg``; returns the report's path."""
    rows = run.rows(ANYTIME)
    svg.write_first_view(plot_data.anytime(rows), charts.anytime, run.path / "anytime.svg")
    return markdown.write(run, __package__, figures.summary(rows), report=report(run), failures=figures.failures(rows),
                          wrong=WRONG)


def content(run: Run) -> Content:
    """What stands on the page."""
    found = report(run)
    shown = figure("anytime", "Accuracy within sampling periods",
                   "The best relative cost gap that is there within a budget of sampling periods, median over the problems of a "
                   "set and size; gaps below 1e-17 are drawn at that.",
                   plot_data.anytime(run.rows(ANYTIME)), charts.anytime)
    failed = figures.failures(run.rows(ANYTIME))
    wrong = [Grid.of_text("What went wrong", WRONG, [[*map(str, line)] for line in failed], 7)] if failed else []
    return Content(found.sentences, shown, [*grids(found), *wrong], DEFINITIONS)
