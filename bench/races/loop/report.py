"""The report of a closed-loop race: words and tables, Markdown, and what stands on its page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from bench.races.loop import charts, figures
from bench.races.loop.race import LOOP
from bench.report import markdown, svg
from bench.report.markdown import Report, Table
from bench.report.race_page import Content, figure, grids
from bench.store import Run

WRONG = ("stage", "solver", "lane", "tier", "status", "message")
DEFINITIONS = (
    "Every solver learns in the same loop on the same stage, reference and noise, each in a process of its own.",
    "The cost gap is exact, of the weights taken over last against the certified optimum of the data that they were learned from.",
    "Time to learn is counted from the last sample of the building phase to the decision; staleness from the last sample that was "
    "learned from.")


def report(run: Run) -> Report:
    """Verdict and tables."""
    rows = run.rows(LOOP)
    table = figures.summary(rows)
    headings = ("solver", "lane", "cost gap", "RMS, %", "RMS, nm", "largest, %", "largest, nm", "time to learn, samples",
                "staleness, samples", "taken over", "refused", "status")
    tables = [Table(f"Stage: {problem}, last window", headings,
                    [[line.who, line.lane, _number(line.cost_gap, ".1e"), f"{line.rms_percent:.4f}",
                      f"{1e3 * line.rms_um:.1f}", f"{line.max_percent:.3f}", f"{1e3 * line.max_um:.0f}",
                      _number(line.learn_samples, ".0f"), _number(line.stale_samples, ".0f"), str(line.hand_overs),
                      str(line.refused), line.status] for _, line in part.iterrows()], 2)
              for problem, part in table.groupby("problem", sort=False)]
    return Report(list(figures.verdict(table)), [*tables, _by_window(rows, table)])


def _by_window(rows: pd.DataFrame, table: pd.DataFrame) -> Table:
    """RMS errors of both axes together in each window, in the order of the summary."""
    errors = figures.by_window(rows)
    lines = [[line.problem, line.who, *(f"{value:.4f}" for value in errors.loc[tuple(line[figures.GROUP])])]
             for _, line in table.iterrows()]
    return Table("RMS error in each window, % of range", ("stage", "solver", *(str(1 + int(w)) for w in errors.columns)), lines, 2)


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "–"


def write(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and ``loop.svg``; returns the report's path."""
    rows = run.rows(LOOP)
    table = figures.summary(rows)
    svg.write(charts.closed_loop(figures.closed_loop(rows)), run.path / "loop.svg")
    who = ["problem", "solver", "lane", "tier"]
    failures = rows[rows.message != ""].drop_duplicates(who)[[*who, "status", "message"]].values.tolist()
    return markdown.write(run, __package__, table, report=report(run), failures=failures, wrong=WRONG)


def content(run: Run) -> Content:
    """What stands on the page."""
    found = report(run)
    shown = figure("closed_loop", "Tracking against cost gap and time to learn",
                   "RMS error of both axes over the last window, per cent of the reference's range, against the exact cost gap "
                   "of the weights in use (gaps below 1e-17 drawn at that) and against the time to learn them, for a stage that stays as it is "
                   "and one whose actuators drift. Dashed: a straight line in place of a model.",
                   figures.closed_loop(run.rows(LOOP)), charts.closed_loop)
    return Content(found.sentences, shown, grids(found), DEFINITIONS)
