"""What the closed-loop race found: whether the stage notices how exact its solver is, as table, plot and words.

A *summary* row stands for one solver with its settings on one stage: errors of both axes together over the last window, and
the worse axis for cost gap, time to learn and staleness.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bench.experiment.rig import RANGE_UM
from bench.experiment.style import HINDSIGHT, LEARNED, STRAIGHT, look
from bench.races.closed_loop import DRIFTING, LOOP, STILL
from bench.rendering import markdown_templates
from bench.report.markdown import settings_label
from bench.report.plots import FLOOR
from bench.report.race_reports import Report, Table
from bench.store import Run
from piezo_model.atomic_file import replacing, write_text
from solvers import Status

NOTICED = 1.1
"""The stage notices where its error is more than 10 % above the least."""
EXACT = 1e-6
"""Cost gaps up to this are called exact."""
NAMED = 6
"""Solvers that a sentence names."""
GROUP = ["problem", "solver", "lane", "tier", "settings"]


def root_mean_square(values: pd.Series) -> float:
    """Axes taken together."""
    return float(np.sqrt(np.mean(values**2)))


def worst(values: pd.Series) -> float:
    """The largest, NaN where any is."""
    return float(values.max(skipna=False))


def least_good(values: pd.Series) -> str:
    """Ok where all are, else the first that is not."""
    return next((str(value) for value in values if value != Status.OK), str(Status.OK))


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row a stage, solver and settings; the nearest to the reference first, those that failed left out."""
    last = rows[(rows.window >= 0) & (rows.window == rows.window.max())]
    table = last.groupby(GROUP).agg(
        status=("status", least_good), rms_percent=("rms_percent", root_mean_square), max_percent=("max_percent", "max"),
        straight_rms_percent=("straight_rms_percent", root_mean_square), hand_overs=("hand_overs", "min"),
        refused=("refused", "max"), learn_samples=("learn_samples", worst), stale_samples=("stale_samples", worst),
        cost_gap=("cost_gap", worst)).reset_index()
    table["rms_um"] = table.rms_percent / 100.0 * RANGE_UM
    table["max_um"] = table.max_percent / 100.0 * RANGE_UM
    table["who"] = [f"{line.solver}, {settings_label(line.settings) or line.tier}" for line in table.itertuples()]
    return table.sort_values(["problem", "rms_percent"], ascending=[False, True], ignore_index=True)


def verdict(table: pd.DataFrame) -> Iterator[str]:
    """Say from which accuracy on the stage does not notice the solver any more."""
    for problem, part in table.groupby("problem", sort=False):
        learned = part[part.cost_gap.notna()]
        if learned.empty:
            yield f"On the {problem} stage nobody learned anything that was taken over."
            continue
        best = learned.iloc[0]
        near = learned.rms_percent <= NOTICED * best.rms_percent
        yield (f"On the {problem} stage the least error is {best.rms_percent:.3f} % RMS of range ({1e3 * best.rms_um:.0f} nm), that "
               f"of {best.who}, where a straight line in place of a model leaves {best.straight_rms_percent:.2f} %; {near.sum()} of "
               f"{len(part)} learners are within 10 % of it, with cost gaps up to {learned[near].cost_gap.max():.1e}.")
        often = learned.refused > best.refused
        if (refused := learned[~near & often]).size:
            yield (f"Farther away, since more of the answers were refused ({refused.refused.max()} where the best had "
                   f"{best.refused}): {_names(refused)}.")
        if (far := learned[~near & ~often]).size:
            yield (f"Farther away, with errors up to {far.rms_percent.max():.3f} % and cost gaps from {far.cost_gap.min():.1e} on: "
                   f"{_names(far)}.")
        exact = learned[(learned.cost_gap <= EXACT) & ~often]
        if len(exact) > 1:
            least, most = (f"{value:.4f} %" for value in (exact.rms_percent.min(), exact.rms_percent.max()))
            yield (f"The {len(exact)} with a gap of at most {EXACT:g} and no more refusals "
                   + (f"all leave {least}" if least == most else f"leave between {least} and {most}")
                   + f", though they take from {exact.learn_samples.min():.0f} to {exact.learn_samples.max():.0f} samples to learn.")


def _names(part: pd.DataFrame) -> str:
    """The first few solvers, each with the settings or tiers of its learners."""
    by_solver = [f"{solver} with {', '.join(who.removeprefix(f'{solver}, ') for who in learners)}"
                 for solver, learners in part.groupby("solver", sort=False).who]
    return "; ".join(by_solver[:NAMED]) + (f" and {len(by_solver) - NAMED} more" if len(by_solver) > NAMED else "")


def loop_report(run: Run) -> Report:
    """Verdict and tables of a closed-loop race."""
    rows = run.rows(LOOP)
    table = summary(rows)
    headings = ("solver", "lane", "cost gap", "RMS, %", "RMS, nm", "largest, %", "largest, nm", "time to learn, samples",
                "staleness, samples", "taken over", "refused", "status")
    tables = [Table(f"Stage: {problem}, last window", headings,
                    [[line.who, line.lane, _number(line.cost_gap, ".1e"), f"{line.rms_percent:.4f}",
                      f"{1e3 * line.rms_um:.1f}", f"{line.max_percent:.3f}", f"{1e3 * line.max_um:.0f}",
                      _number(line.learn_samples, ".0f"), _number(line.stale_samples, ".0f"), str(line.hand_overs),
                      str(line.refused), line.status] for _, line in part.iterrows()], 2)
              for problem, part in table.groupby("problem", sort=False)]
    return Report(list(verdict(table)), [*tables, _by_window(rows, table)])


def _by_window(rows: pd.DataFrame, table: pd.DataFrame) -> Table:
    """RMS errors of both axes together in each window, in the order of the summary."""
    errors = rows[rows.window >= 0].groupby([*GROUP, "window"]).rms_percent.agg(root_mean_square).unstack()
    lines = [[line.problem, line.who, *(f"{value:.4f}" for value in errors.loc[tuple(line[GROUP])])]
             for _, line in table.iterrows()]
    return Table("RMS error in each window, % of range", ("stage", "solver", *(str(1 + int(w)) for w in errors.columns)), lines, 2)


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "–"


def write_loop(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and ``loop.svg``; returns the report's path."""
    rows = run.rows(LOOP)
    table = summary(rows)
    with replacing(run.path / "summary.csv") as temporary:
        table.to_csv(temporary, index=False)
    plot(table, run.path / "loop.svg")
    who = ["problem", "solver", "lane", "tier"]
    failures = rows[rows.message != ""].drop_duplicates(who)[[*who, "status", "message"]].values.tolist()
    write_text(run.path / "report.md", markdown_templates("bench.report").get_template("loop.md.jinja").render(
        name=run.path.name, settings=run.settings, report=loop_report(run), failures=failures))
    return run.path / "report.md"


def plot(table: pd.DataFrame, path: Path) -> None:
    """Cost gap, tracking error and staleness side by side, a line a solver, the most exact one on top."""
    order = table.groupby("who").cost_gap.max().sort_values(ascending=False, na_position="first").index
    with look():
        figure = Figure(figsize=(9.0, 1.3 + 0.2 * len(order)), layout="constrained")
        panels = figure.subplots(1, 3, sharey=True)
        for problem, colour, marker, size in ((STILL, LEARNED, "o", 5), (DRIFTING, STRAIGHT, "x", 5)):
            part = table[table.problem == problem].set_index("who").reindex(order)
            drawn = (np.maximum(part.cost_gap, FLOOR), part.rms_percent, part.learn_samples)
            for axes, values in zip(panels, drawn, strict=True):
                axes.plot(values, np.arange(len(order)), color=colour, marker=marker, ms=size, ls="", label=f"{problem} stage")
            panels[1].axvline(part.rms_percent.min(), color=colour, lw=0.8, ls=":")
        names = ("relative cost gap in use", "RMS error, % of range", "staleness, samples")
        for axes, name in zip(panels, names, strict=True):
            axes.set(xscale="log", xlabel=name)
        panels[0].set_yticks(range(len(order)), order)
        panels[0].set_ylim(-1.0, len(order))
        if len(table):
            panels[1].axvline(float(table.straight_rms_percent.median()), color=HINDSIGHT, ls="--", label="straight line")
        figure.legend(*panels[1].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        with replacing(path) as temporary:
            figure.savefig(temporary, format="svg", metadata={"Date": None})
