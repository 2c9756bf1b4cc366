"""The report of a stream race: words and tables, Markdown, and what stands on its page."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from bench.races.settings import settings_of
from bench.races.stream import charts, figures, plot_data
from bench.races.stream.race import STREAM, StreamSettings
from bench.report import markdown, svg
from bench.report.markdown import Report, Table, gap, number, settings_label
from bench.report.race_page import Content, figure, grids
from bench.store import Run
from bench.timing import latency_histogram
from bench.timing.percentiles import QUANTILES, Percentile, needed

NAMES = ("solver", "lane", "tier", "settings")
QUANTILE_NAMES = tuple(Percentile(q).name for q in QUANTILES)
WRONG = ("solver", "lane", "tier", "settings", "status", "message")
DEFINITIONS = (
    "Response is from the due time of a sample to the end of the first solve that includes it, service from the begin to the "
    "end of a solve; a missed deadline is a response above 125 µs.",
    "Beyond the floor are misses above the upper 95 % bound of the rate at which a solver that does nothing misses; a "
    "percentile marked ≈ floor has an interval that reaches into that solver's.",
    "Percentiles are order statistics with distribution-free 95 % intervals; one that the sample cannot support is refused.",
    "Gap: the cost of the answer in use at the deadline of each sample above the optimum of that sample, over the optimal cost.",
    "The compiled loops take the same rows back to back, without waiting: they have no response times.")


def report(run: Run) -> Report:
    """Verdict and tables."""
    return report_of(figures.summary(run.rows(STREAM), run.times()), settings_of(run, StreamSettings).to_dict())


def write(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and ``latency.svg``; returns the report's path."""
    rows, times = run.rows(STREAM), run.times()
    table = figures.summary(rows, times)
    svg.write_first_view(plot_data.latency_tails(rows, times), charts.latency_tails, run.path / "latency.svg")
    return markdown.write(run, __package__, table.drop(columns=[name for name in table.columns if name.endswith("histogram")]),
                          report=report_of(table, settings_of(run, StreamSettings).to_dict()),
                          failures=table[table.message != ""][[*WRONG]].values.tolist(), wrong=WRONG)


def report_of(table: pd.DataFrame, settings: Mapping[str, Any]) -> Report:
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
               lambda line: [gap(line.gap_mean), gap(line.gap_max), gap(line.exact_gap_mean), gap(line.exact_gap_max),
                             gap(line.own_gap_max), _percent(line.reused), str(line.unanswered)]),
        _table("Service time in compiled loops, µs, back to back and not paced",
               (*QUANTILE_NAMES, "max", f"{QUANTILE_NAMES[-1]} corrected", "rows", "stopped", "status"), kernel,
               lambda line: [*_percentiles(line, "service"), _corrected(line), str(line.samples), line.stopped,
                             line.status])]
    return Report(figures.verdict(table, settings), [table for table in tables if table.rows])


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
    value, low, high = (line[figures.column(kind, q, end)] for end in ("", "low", "high"))
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


def content(run: Run) -> Content:
    """What stands on the page."""
    rows, times = run.rows(STREAM), run.times()
    found = report(run)
    shown = [
        *figure("deadline_profile", "Deadline profile",
                "Share of samples answered within k sampling periods of their due time. The deadline is one period.",
                plot_data.deadline_profile(rows, times), charts.deadline_profile),
        *figure("latency_tails", "Latency tails",
                "Response time, from the due time of a sample to its answer, by percentile, as far as the number of samples "
                f"supports it. {plot_data.FLOOR_NAME.capitalize()} is a solver that answers at once: a tail that is not "
                "above it is the machine's. Compiled loops, which wait for no schedule, by their service time. The dashed "
                "line is the deadline.",
                plot_data.latency_tails(rows, times), charts.latency_tails)]
    return Content(found.sentences, shown, grids(found), DEFINITIONS)
