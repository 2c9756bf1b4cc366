"""``report.html``: the report of a run as one page, from the same figures as ``report.md``.

What is shown follows from the tables that the run's folder holds; a plot without data is left out.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import altair as alt
import pandas as pd

from bench.races.anytime import ANYTIME
from bench.races.closed_loop import LOOP
from bench.races.stream import STREAM
from bench.report import (
    anytime_figures,
    charts,
    figures,
    loop_report,
    markdown,
    plot_data,
    race_reports,
    stream_plot_data,
)
from bench.report.page import Cell, Figure, Grid, save
from bench.store import ONESHOT, Run

FILTERS = ("problem set", "scaling", "lane", "tier", "start", "status")
FIRST = ("solver", "lane", "tier", "right", "worst_cost_gap", "update_us", "solve_us_p50", "periods", "status")
HEADINGS = {key: {**markdown.HEADINGS, "problem_set": "problem set", "scaling": "scaling"}[key] for key in dict.fromkeys(
    (*FIRST, "problem_set", "scaling", *markdown.HEADINGS))}
"""Who, right and how fast come first, for a screen without the room for all."""
NAMES = 3
TITLES = {"oneshot": "One-shot race", "stream": "Stream race", "anytime": "Anytime race", "loop": "Closed-loop race"}
FAILURE = ("solver", "lane", "tier", "scaling", "problem", "status", "message")
FAILURES = ("solver", "lane", "tier", "scaling", "status", "times", "such as", "message")
ONESHOT_DEFINITIONS = (
    "right: problems whose relative cost gap (exact arithmetic, against the certified optimum) and constraint violation are "
    "within the tier's tolerance: default and low 1e-3, mid 1e-6, high 1e-9.",
    "scaled: P has a unit diagonal; raw: volts and micrometres.",
    "primal and dual residual: those of qpsolvers.Solution from the solver's own duals, worst over the problems.",
    "weight error: ‖w − w*‖∞ / ‖w*‖∞; model error: RMS error on data that the fit has not seen, per cent of range, median.",
    "Times are medians over the problems; every solve follows an update with all of P and q. Hot times are of the same solver "
    "again and again; interleaved ones of solvers that take turns, so that each finds cold caches.",
    "periods: update and solve in sampling periods of 125 µs, or the steps of a method that does one step a period.",
    "p99 is given where the sample supports it on every problem; – stands for what is not known.",
    "The lane is part of the price: qpsolvers converts and sets up at every call, cvxpy adds its own layer.")
STREAM_DEFINITIONS = (
    "Response is from the due time of a sample to the end of the first solve that includes it, service from the begin to the "
    "end of a solve; a missed deadline is a response above 125 µs.",
    "Beyond the floor are misses above the upper 95 % bound of the rate at which a solver that does nothing misses; a "
    "percentile marked ≈ floor has an interval that reaches into that solver's.",
    "Percentiles are order statistics with distribution-free 95 % intervals; one that the sample cannot support is refused.",
    "Gap: the cost of the answer in use at the deadline of each sample above the optimum of that sample, over the optimal cost.",
    "The compiled loops take the same rows back to back, without waiting: they have no response times.")
ANYTIME_DEFINITIONS = (
    "Solvers with a limit of iterations ran with growing limits, from a cold start each time; the others give the one point of "
    "their full solve. The gap within a budget is the best of what is there by then; –: nothing yet.",
    "The gap is exact, of the feasible point nearest to the iterate, against the certified optimum.",
    "One step a sample: the paper's pace, where a step takes a period whatever it costs.")

LOOP_DEFINITIONS = (
    "Every solver learns in the same loop on the same stage, reference and noise, each in a process of its own.",
    "The cost gap is exact, of the weights taken over last against the certified optimum of the data that they were learned from.",
    "Time to learn is counted from the last sample of the building phase to the decision; staleness from the last sample that was "
    "learned from.")


@dataclass(frozen=True)
class Content:
    """What one table of a run gives to the page."""

    sentences: Sequence[str]
    figures: Sequence[Figure]
    tables: Sequence[Grid]
    definitions: Sequence[str]


@dataclass(frozen=True)
class Picture:
    """A figure of an experiment that lies in the run's folder, drawn already."""

    title: str
    source: str
    """SVG as a data address: a picture, in which nothing runs."""
    table: str
    """Path of its numbers from the page, or ""."""

    @classmethod
    def of(cls, path: Path) -> Picture:
        """Take the picture in."""
        table = path.with_suffix(".csv")
        drawn = b64encode(path.read_bytes()).decode("ascii")
        return cls(path.stem.replace("_", " ").capitalize(), f"data:image/svg+xml;base64,{drawn}",
                   f"{path.parent.name}/{table.name}" if table.is_file() else "")


def write(run: Run) -> Path:
    """Write ``report.html`` and ``figures/*.csv`` into the run's folder; returns the page's path."""
    contents = [make(run) for file, make in SOURCES.items() if (run.path / file).is_file()]
    settings = run.settings
    race = str(settings.get("race", "oneshot"))
    pictures = sorted((run.path / "experiment").glob("*.svg"))
    conditions = settings.get("conditions", {}).get("warnings", [])
    return save(run.path / "report.html", "report.html.jinja",
                [figure for content in contents for figure in content.figures],
                title=f"{TITLES.get(race, race)} {run.path.name}",
                sentences=[text for content in contents for text in content.sentences],
                tables=[table for content in contents for table in content.tables],
                definitions=[text for content in contents for text in content.definitions],
                limits=["One machine, one run: compare ratios, not microseconds.", *settings["machine"]["warnings"],
                        *conditions],
                environment=environment(settings), pictures=[Picture.of(path) for path in pictures])


def environment(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Machine, versions and settings as names and texts."""
    machine = settings["machine"]
    field = ", ".join(f"{name} {version}" for name, version in settings.get("field", {}).items())
    absent = ", ".join(settings.get("absent", {}))
    chosen = ", ".join(f"{name} {_said(value)}" for name, value in settings["settings"].items() if value not in ([], None))
    return [(name, text) for name, text in (
        ("machine", f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"),
        ("Python", f"{machine['python']}; " + ", ".join(f"{name} {v}" for name, v in machine["versions"].items())),
        ("settings", chosen), ("solvers", field), ("absent", absent)) if text]


def _said(value: Any) -> str:
    if isinstance(value, list | dict):
        items = value.items() if isinstance(value, dict) else ((None, item) for item in value)
        return "(" + ", ".join(f"{name} {item}" if name else str(item) for name, item in items) + ")"
    return str(value)


def figure(name: str, title: str, definition: str, data: pd.DataFrame,
           draw: Callable[[pd.DataFrame], list[alt.TopLevelMixin]]) -> list[Figure]:
    """The figure, or none where there is nothing to draw."""
    return [Figure(name, title, definition, data, draw(data))] if len(data) else []


def oneshot(run: Run) -> Content:
    """Of a one-shot race."""
    rows = run.rows(ONESHOT)
    table = figures.summary(rows)
    cells = [[Cell(markdown.text(line, key), _key(line, key)) for key in HEADINGS] for _, line in table.iterrows()]
    grids = [Grid("Who is right, and how fast", [*HEADINGS.values()], cells, NAMES, FILTERS)]
    if failed := figures.failures(rows):
        grids.append(Grid.of_text("What went wrong", FAILURES, failed, 8, ("lane", "tier", "scaling", "status")))
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
    return Content(figures.verdict(rows).sentences, shown, grids, ONESHOT_DEFINITIONS)


def _key(line: pd.Series, column: str) -> str | float:
    """What a cell is sorted by."""
    value = line[column]
    if column == "right":
        return float(line.right / line.problems)
    return markdown.text(line, column) if isinstance(value, str) or pd.isna(value) else float(value)


def stream(run: Run) -> Content:
    """Of a stream race."""
    rows, times = run.rows(STREAM), run.times()
    report = race_reports.stream_report(run)
    shown = [
        *figure("deadline_profile", "Deadline profile",
                "Share of samples answered within k sampling periods of their due time. The deadline is one period.",
                stream_plot_data.deadline_profile(rows, times), charts.deadline_profile),
        *figure("latency_tails", "Latency tails",
                "Response time, from the due time of a sample to its answer, by percentile, as far as the number of samples "
                f"supports it. {stream_plot_data.FLOOR_NAME.capitalize()} is a solver that answers at once: a tail that is not "
                "above it is the machine's. The dashed line is the deadline.",
                stream_plot_data.latency_tails(rows, times), charts.latency_tails)]
    return Content(report.sentences, shown, _grids(report), STREAM_DEFINITIONS)


def anytime(run: Run) -> Content:
    """Of an anytime race."""
    report = race_reports.anytime_report(run)
    shown = figure("anytime", "Accuracy within sampling periods",
                   "The best relative cost gap that is there within a budget of sampling periods, median over the problems of a "
                   "set and size; gaps below 1e-17 are drawn at that.",
                   stream_plot_data.anytime(run.rows(ANYTIME)), charts.anytime)
    failed = anytime_figures.failures(run.rows(ANYTIME))
    wrong = [Grid.of_text("What went wrong", FAILURE, [[*map(str, line)] for line in failed], 7)] if failed else []
    return Content(report.sentences, shown, [*_grids(report), *wrong], ANYTIME_DEFINITIONS)


def loop(run: Run) -> Content:
    """Of a closed-loop race."""
    report = loop_report.loop_report(run)
    shown = figure("closed_loop", "Tracking against cost gap",
                   "RMS error of both axes over the last window, per cent of the reference's range, against the exact cost gap "
                   "of the weights in use (gaps below 1e-17 drawn at that), for a stage that stays as it is and one whose "
                   "actuators drift. Dashed: a straight line in place of a model.",
                   stream_plot_data.closed_loop(run.rows(LOOP)), charts.closed_loop)
    return Content(report.sentences, shown, _grids(report), LOOP_DEFINITIONS)


def _grids(report: race_reports.Report) -> list[Grid]:
    return [Grid.of_text(table.title, table.headings, table.rows, table.left, ("lane", "tier", "status", "pace"))
            for table in report.tables]


SOURCES: dict[str, Callable[[Run], Content]] = {ONESHOT.file: oneshot, STREAM.file: stream, ANYTIME.file: anytime,
                                                    LOOP.file: loop}
"""By the table that they are made from."""
