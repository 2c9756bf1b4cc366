"""The reports of the stream and the anytime race as Markdown, with their summaries as CSV and their plots as SVG."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bench.races.anytime import ANYTIME, BUDGETS
from bench.races.stream import STREAM
from bench.rendering import markdown_templates
from bench.report import anytime_figures, race_plots, stream_figures
from bench.report.markdown import settings_label
from bench.report.stream_figures import number
from bench.store import Run
from bench.timing import latency_histogram
from bench.timing.percentiles import QUANTILES, Percentile, needed
from piezo_model.atomic_file import replacing, write_text

NAMES = ("solver", "lane", "tier", "settings")
QUANTILE_NAMES = tuple(Percentile(q).name for q in QUANTILES)


@dataclass(frozen=True)
class Table:
    """A table with its cells as text."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int
    """Columns of names, aligned to the left."""


@dataclass(frozen=True)
class Report:
    """What is said and shown of a run: the verdict first, then tables."""

    sentences: Sequence[str]
    tables: Sequence[Table]


def stream_report(run: Run) -> Report:
    """Verdict and tables of a stream race."""
    return stream_report_of(stream_figures.summary(run.rows(STREAM), run.times()), run.settings["settings"])


def write_stream(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and ``latency.svg``; returns the report's path."""
    table = stream_figures.summary(run.rows(STREAM), run.times())
    race_plots.latency(table, run.path / "latency.svg")
    failed = table[table.message != ""][["solver", "lane", "tier", "settings", "status", "message"]]
    return _write(run, "stream.md.jinja", stream_report_of(table, run.settings["settings"]),
                  table.drop(columns=[name for name in table.columns if name.endswith("histogram")]),
                  failed.values.tolist())


def anytime_report(run: Run) -> Report:
    """Verdict and tables of an anytime race."""
    rows = run.rows(ANYTIME)
    wide = anytime_figures.wide(anytime_figures.summary(rows))
    headings = ("solver", "lane", "tier", "pace", *(str(budget) for budget in BUDGETS))
    tables = [Table(f"{problem_set}, d = {d}, {scaling} data: median relative cost gap within so many sampling periods",
                    headings, [[*map(str, line[list(headings[:4])]), *(_gap(line[budget]) for budget in BUDGETS)]
                               for _, line in part.iterrows()], 4)
              for (problem_set, d, scaling), part in wide.groupby(["problem_set", "d", "scaling"], sort=False)]
    return Report(anytime_figures.verdict(rows), tables)


def write_anytime(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and ``anytime.svg``; returns the report's path."""
    rows = run.rows(ANYTIME)
    race_plots.anytime(rows, run.path / "anytime.svg")
    return _write(run, "anytime.md.jinja", anytime_report(run), anytime_figures.summary(rows), anytime_figures.failures(rows))


def _write(run: Run, template: str, report: Report, summary: pd.DataFrame, failures: Iterable[Sequence[Any]]) -> Path:
    with replacing(run.path / "summary.csv") as temporary:
        summary.to_csv(temporary, index=False)
    write_text(run.path / "report.md", markdown_templates("bench.report").get_template(template).render(
        name=run.path.name, settings=run.settings, report=report, failures=list(failures)))
    return run.path / "report.md"


def stream_report_of(table: pd.DataFrame, settings: Mapping[str, Any]) -> Report:
    """Verdict and tables from the summary and the settings of a stream race."""
    paced, kernel = ([line for _, line in part.iterrows()] for part in (table[table.paced], table[~table.paced]))
    tables = [
        _table("Response time on the schedule, µs: due time to answer",
               (*QUANTILE_NAMES, "max", "missed", "stalls", "beyond the floor", "status"), paced,
               lambda line: [*_percentiles(line, "response"), f"{line.missed}/{line.samples}", str(line.stalls),
                             str(line.missed_beyond_floor), line.status]),
        _table("Service time on the schedule, µs: begin to answer",
               (*QUANTILE_NAMES, "max", "update p50", "solve p50", "solves", "stopped"), paced,
               lambda line: [*_percentiles(line, "service"), number(line.update_us_p50), number(line.solve_us_p50),
                             str(line.solves), line.stopped]),
        _table("Relative cost gap of the answer in use",
               ("mean", "max", "exact mean", "exact max", "own answers", "reused", "unanswered"), paced + kernel,
               lambda line: [_gap(line.gap_mean), _gap(line.gap_max), _gap(line.exact_gap_mean), _gap(line.exact_gap_max),
                             _gap(line.own_gap_max), _percent(line.reused), str(line.unanswered)]),
        _table("Service time in compiled loops, µs, back to back and not paced",
               (*QUANTILE_NAMES, "max", f"{QUANTILE_NAMES[-1]} corrected", "rows", "stopped", "status"), kernel,
               lambda line: [*_percentiles(line, "service"), _corrected(line), str(line.samples), line.stopped,
                             line.status])]
    return Report(stream_figures.verdict(table, settings), [table for table in tables if table.rows])


def _table(title: str, headings: Sequence[str], lines: Iterable[pd.Series], cells: Callable[[pd.Series], Sequence[str]],
           ) -> Table:
    """A table of solver lanes."""
    rows = [[line.solver, line.lane, line.tier, settings_label(str(line.settings)), *cells(line)] for line in lines]
    return Table(title, (*NAMES, *headings), rows, len(NAMES))


def _percentiles(line: pd.Series, kind: str) -> list[str]:
    """All percentiles of a kind and the maximum."""
    return [*(_percentile(line, kind, q) for q in QUANTILES), number(line[f"{kind}_max_us"])]


def _percentile(line: pd.Series, kind: str, q: float) -> str:
    """Value and interval, or what is missing; marked where it is not above the machine's floor."""
    value, low, high = (line[stream_figures.column(kind, q, end)] for end in ("", "low", "high"))
    if math.isnan(value):
        return f"needs {needed(q)}"
    at_floor = kind == "response" and not line.is_floor and line[f"at_floor_{Percentile(q).name}"]
    return f"{number(value)} ({number(low)} to {number(high)})" + (" ≈ floor" if at_floor else "")


def _corrected(line: pd.Series) -> str:
    """The farthest percentile with what would have waited behind long calls on a schedule counted in."""
    if line.samples < needed(QUANTILES[-1]):
        return f"needs {needed(QUANTILES[-1])}"
    return number(float(latency_histogram.quantiles(line.response_histogram, QUANTILES[-1])[0]) / 1e3)


def _percent(share: float) -> str:
    return "–" if math.isnan(share) else f"{100.0 * share:.3g} %"


def _gap(value: float) -> str:
    return "–" if not math.isfinite(value) else f"{value:.1e}"
