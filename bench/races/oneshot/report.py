"""The report of a one-shot race: in the terminal, as Markdown with its summary as CSV, and what stands on its page."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bench import rendering
from bench.races.oneshot import charts, figures, plot_data
from bench.races.oneshot.rows import ONESHOT
from bench.report import markdown, svg
from bench.report.markdown import Report, Table, settings_label
from bench.report.page import Cell, Grid
from bench.report.race_page import Content, figure
from bench.store import Run

HEADINGS = {"solver": "solver", "lane": "lane", "tier": "tier", "rung": "rung", "start": "start", "settings": "settings", "right": "right",
            "worst_cost_gap": "worst cost gap", "worst_primal_residual": "primal residual",
            "worst_dual_residual": "dual residual", "worst_weight_error": "weight error",
            "model_error_percent": "model error, %", "setup_us": "setup, µs", "update_us": "update, µs",
            "solve_us_p50": "solve p50, µs", "solve_us_p99": "p99", "solve_us_max": "max",
            "interleaved_us_p50": "interleaved p50", "periods": "periods",
            "status": "status"}
UNSHOWN = ("worst_primal_residual", "worst_dual_residual", "solve_us_max")
"""Columns for which the terminal has no room."""
WRONG = ("solver", "lane", "tier", "scaling", "status", "times", "such as", "message")
FILTERS = ("problem set", "scaling", "lane", "tier", "start", "status")
FIRST = ("solver", "lane", "tier", "right", "worst_cost_gap", "update_us", "solve_us_p50", "periods", "status")
PAGE_HEADINGS = {key: {**HEADINGS, "problem_set": "problem set", "scaling": "scaling"}[key] for key in dict.fromkeys(
    (*FIRST, "problem_set", "scaling", *HEADINGS))}
"""Who, right and how fast come first, for a screen without the room for all."""
NAMES = 3
DEFINITIONS = (
    "right: problems whose relative cost gap (exact arithmetic, against the certified optimum) and constraint violation (relative to "
    "the largest number of the optimum) are what the tier asks: default and low 1e-3, mid 1e-6, high 1e-9, exact 1e-12; stage: the "
    "model errs on unseen data at most 1 % of the sensor's noise more than the optimum's. High is numerics, stage is engineering.",
    "rung: which of the settings that a library's ladder holds, from loose to tight; the loosest that reaches the tier on problems of "
    "other seeds, -1 for what the library does unasked. The settings shown are those of the first problem.",
    "scaled: P has a unit diagonal; raw: volts and micrometres.",
    "primal and dual residual: those of qpsolvers.Solution from the solver's own duals, worst over the problems.",
    "weight error: ‖w − w*‖∞ / ‖w*‖∞; model error: RMS error on data that the fit has not seen, per cent of range, median.",
    "Times are medians over the problems; every solve follows an update with all of P and q. Hot times are of the same solver "
    "again and again; interleaved ones of solvers that take turns, so that each finds cold caches.",
    "periods: update and solve in sampling periods of 125 µs, or the steps of a method that does one step a period.",
    "p99 is given where the sample supports it on every problem; – stands for what is not known.",
    "The lane is part of the price: qpsolvers converts and sets up at every call, cvxpy adds its own layer.")


def cell(row: pd.Series, column: str) -> str:
    """One cell of the table as Markdown."""
    return rendering.markdown(text(row, column))


def text(row: pd.Series, column: str) -> str:
    """One cell of the table as plain text."""
    value = row[column]
    if column == "right":
        return "–" if row.status == figures.FLOOR else f"{row.right}/{row.problems}"
    if column == "settings":
        return settings_label(str(value))
    if isinstance(value, float):
        if pd.isna(value):
            return "–"
        return f"{value:.1e}" if "gap" in column or "residual" in column or "weight" in column else f"{value:.3g}"
    return str(value)


def report(run: Run) -> Report:
    """Verdict and the most exact tier of each solver lane."""
    rows = run.rows(ONESHOT)
    table = figures.summary(rows)
    headings = {key: text for key, text in HEADINGS.items() if key not in UNSHOWN}
    tables = []
    shown = figures.at_tiers(table[table.status != figures.FLOOR])
    for (problem_set, scaling), part in shown.groupby(["problem_set", "scaling"], sort=False):
        best = part.sort_values("tier", key=lambda tiers: tiers.map(plot_data.MOST_EXACT.index)).drop_duplicates(
            ["solver", "lane", "start"]).sort_values(["all_right", "total_us"], ascending=[False, True])
        tables.append(Table(f"{problem_set}, {scaling} data, the most exact tier of each", list(headings.values()),
                            [[cell(row, key) for key in headings] for _, row in best.iterrows()], 4))
    return Report(figures.verdict(rows).sentences, tables, table.to_dict("records"))


def write(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and the plots, with several sizes ``sizes.svg`` too; returns the report's path."""
    rows = run.rows(ONESHOT)
    table, sizes = figures.summary(rows), plot_data.time_by_size(rows)
    svg.write_first_view(plot_data.accuracy(rows), charts.accuracy, run.path / "accuracy.svg")
    if len(sizes):
        drawn = plot_data.sizes(rows).merge(sizes[["view", "name"]]).assign(front=True)
        svg.write_first_view(drawn, charts.sizes, run.path / "sizes.svg")
    return markdown.write(
        run, __package__, table, report=report(run), headings=HEADINGS, cell=cell,
        parts=[(*names, [row for _, row in part.iterrows()])
               for names, part in figures.at_tiers(table).groupby(["problem_set", "scaling"], sort=False)],
        problems=rows.drop_duplicates(["problem_set", "problem"])[["problem_set", "problem", "d"]].values.tolist(),
        failures=figures.failures(rows), wrong=WRONG, sizes=sizes.to_dict("records"))


def content(run: Run) -> Content:
    """What stands on the page."""
    rows = run.rows(ONESHOT)
    table = figures.summary(rows)
    cells = [[Cell(text(line, key), _key(line, key)) for key in PAGE_HEADINGS] for _, line in figures.at_tiers(table).iterrows()]
    grids = [Grid("Who is right, and how fast", [*PAGE_HEADINGS.values()], cells, NAMES, FILTERS)]
    if failed := figures.failures(rows):
        grids.append(Grid.of_text("What went wrong", WRONG, failed, 8, ("lane", "tier", "scaling", "status")))
    shown = [
        *figure("accuracy", "Accuracy against time",
                "Each point is a solver lane at the most exact tier that it raced: the worst relative cost gap over the problems "
                "(exact arithmetic, gaps below 1e-17 drawn at that) against the median of update and solve. Left of the dashed "
                "line an answer is there before the next sample. The line of points is the paper's method, which takes one step "
                "a period. Names stand where there is room, first of those that no other beats in both. Click a lane to see it alone.",
                plot_data.accuracy(rows), charts.accuracy),
        *figure("performance_profile", "Performance profile",
                "ρ(τ) is the share of problems that a solver lane answers right within τ times the time of the fastest right "
                "answer to each (Dolan and Moré 2002): higher is better, the left end says how often it is the fastest, the "
                "right end how often it is right. A solver lane that is never right has no line.",
                plot_data.performance_profile(rows), charts.performance_profile),
        *figure("sizes", "Time by size",
                "Median time of update and solve by number of unknowns, where every answer of that size was right. The dashed "
                "line is the sampling period.", plot_data.sizes(rows), charts.sizes),
        *figure("stages", "Where the time goes",
                "Medians over the problems. The wrapper is what update and solve take in a lane beyond those of the same library "
                "in the lane direct. The time beside a name is that of update and solve, which every answer costs; the set-up is "
                f"paid once. The {charts.MOST_BARS} fastest of each lane.", plot_data.stages(rows), charts.stages)]
    return Content(figures.verdict(rows).sentences, shown, grids, DEFINITIONS)


def _key(line: pd.Series, column: str) -> str | float:
    """What a cell is sorted by."""
    value = line[column]
    if column == "right":
        return float(line.right / line.problems)
    return text(line, column) if isinstance(value, str) or pd.isna(value) else float(value)
