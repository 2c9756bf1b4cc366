"""Comparisons of runs as one page, as Markdown, and as JSON for machines."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import altair as alt
import numpy as np
import pandas as pd

from bench.comparison.compare import RunComparison
from bench.comparison.matched import NAMES
from bench.races import null_solver
from bench.rendering import markdown_templates
from bench.report import charts
from bench.report.markdown import settings_label
from bench.report.page import Cell, Figure, Grid, save
from piezo_model.atomic_file import write_text

FORMAT, VERSION = "piezobench-comparison", 1
HEADINGS = ("solver", "lane", "change", "ratio", "interval", "problem set", "problem", "scaling", "tier", "start", "settings",
            "adjusted p", "cost gaps", "statuses")
MOST_LANES = 20
"""Solver lanes of which the ratios are drawn."""
COLOURS = {"slower": "#d55e00", "faster": "#009e73", "no difference": "#999999"}
TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.5, 2, 3, 5, 10, 20, 50, 100]
DEFINITIONS = (
    "ratio: median over pairs of the time of the second run over that of the first, in interleaved turns where both runs have "
    "them and hot otherwise; what rows share that were measured together is taken for the machine's before testing.",
    "interval: 95 %, from a circular block bootstrap and the noise band, the spread of the rows that do not differ.",
    "adjusted p: corrected for so many rows (Benjamini and Hochberg); a row is faster or slower where it is below 5 %.",
    "more or less accurate: the exact cost gap differs by more than a factor of 10 and the larger one is above 1e-12.",
    "A regression is a row that is slower, less accurate or gone, or that was right and is so no more.")


def write(comparisons: Sequence[RunComparison], folder: Path) -> Path:
    """Write ``comparison.html``, ``.md``, ``.json`` and the data of the plots; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "comparison.json", json.dumps(to_dict(comparisons), indent=1, allow_nan=False) + "\n")
    content: dict[str, Any] = {
        "title": "Comparison of " + ", ".join([comparisons[0].a.path.name, *(each.b.path.name for each in comparisons)]),
        "comparisons": comparisons, "grids": [grid(each) for each in comparisons], "definitions": DEFINITIONS}
    write_text(folder / "comparison.md", markdown_templates("bench.report").get_template("comparison.md.jinja").render(**content))
    figures = [figure for i, each in enumerate(comparisons) for figure in ratios(each, i)]
    return save(folder / "comparison.html", "comparison.html.jinja", figures, **content)


def to_dict(comparisons: Sequence[RunComparison]) -> dict[str, Any]:
    """Everything as JSON can hold it; null stands for what is not known."""
    return {"format": FORMAT, "version": VERSION, "baseline": str(comparisons[0].a.path), "comparisons": [
        {"run": str(each.b.path), "warnings": list(each.warnings), "notes": list(each.notes), "verdict": each.verdict,
         "difference": bool(len(each.changed)), "regressions": len(each.regressions), "noise": dict(each.noise),
         "rows": [{name: _plain(value) for name, value in row.items()} for row in each.rows.to_dict("records")]}
        for each in comparisons]}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def grid(comparison: RunComparison) -> Grid:
    """The rows that changed, the worst first."""
    changed = comparison.changed.sort_values(["regression", "ratio"], ascending=[False, False])
    rows = [_cells(row) for row in cast(list[dict[str, Any]], changed.to_dict("records"))]
    return Grid(f"Rows that differ: {comparison.b.path.name} against {comparison.a.path.name}", HEADINGS, rows, 3,
                ("lane", "tier", "change"))


def _cells(row: Mapping[str, Any]) -> list[Cell]:
    names = (row["problem_set"], row["problem"], row["scaling"], row["tier"], row["start"], settings_label(row["settings"]))
    low, high = (_number(row[f"ratio_{end}"], ".3f") for end in ("low", "high"))
    statuses = (row["status_a"] or "–", row["status_b"] or "–")
    return [*(Cell(name, name) for name in (row["solver"], row["lane"], ", ".join(row["changes"]))),
            Cell(_number(row["ratio"], ".3f"), row["ratio"]), Cell(f"{low} to {high}", row["ratio_low"]),
            *(Cell(name, name) for name in names), Cell(_number(row["adjusted"], ".1e"), row["adjusted"]),
            Cell(f"{_number(row['gap_a'], '.1e')}, {_number(row['gap_b'], '.1e')}", row["gap_b"]),
            Cell(statuses[0] if statuses[0] == statuses[1] else " → ".join(statuses), statuses[1])]


def _number(value: float, how: str) -> str:
    return "–" if pd.isna(value) else format(value, how)


def ratios(comparison: RunComparison, number: int) -> list[Figure]:
    """Ratios of all rows, one line a solver lane; nothing where no times can be compared."""
    rows = comparison.rows[comparison.rows.ratio.notna()]
    if rows.empty:
        return []
    change = rows.changes.map(lambda changes: next((kind for kind in ("slower", "faster") if kind in changes), "no difference"))
    names = (rows.solver + " (" + rows.lane + ")").where(rows.solver != null_solver.ENTRY.name, "the machine's floor")
    table = rows.assign(name=names, change=change)[
        ["name", *NAMES, "ratio", "ratio_low", "ratio_high", "adjusted", "timed", "change"]]
    farthest = np.log(table.ratio).abs().groupby(table.name).max().sort_values(ascending=False).index[:MOST_LANES]
    shown = table[table.name.isin(farthest)]
    colour = alt.Color("change:N", scale=alt.Scale(domain=[*COLOURS], range=[*COLOURS.values()]), legend=alt.Legend(columns=2))
    tips = [alt.Tooltip(f"{name}:N") for name in ("name", "tier", "problem", "scaling", "change")] + [
        alt.Tooltip(f"{name}:Q", format=".3f") for name in ("ratio", "ratio_low", "ratio_high")]
    source = charts.data(shown.assign(same=1.0))
    base = alt.Chart(source).encode(y=alt.Y("name:N", title=None, sort=list(farthest), axis=alt.Axis(labelLimit=220)))
    points = base.mark_point(filled=True, size=45, opacity=0.7).encode(
        x=alt.X("ratio:Q", title="second run over first", axis=alt.Axis(values=TICKS, format="~g"),
                scale=alt.Scale(type="log", nice=False, domain=[min(0.8, table.ratio.min()), max(1.25, table.ratio.max())])),
        shape=alt.Shape("change:N", scale=alt.Scale(domain=[*COLOURS], range=["triangle-right", "triangle-left", "circle"])),
        color=colour, tooltip=tips)
    rule = alt.Chart(source).mark_rule(strokeDash=[5, 4]).encode(x="min(same):Q")
    bands = ", ".join(f"{100.0 * band:.1f} % for {what.replace('_', ' ')}" for what, band in comparison.noise.items())
    plot = charts.finished(alt.layer(rule, points), None, 40 + charts.ROW * len(farthest))
    return [Figure(f"ratios_{number + 1}", f"Times of {comparison.b.path.name} over those of {comparison.a.path.name}",
                   "Each point is one problem in one scaling at one tier; the solver lanes with the largest changes come first"
                   + (f", {len(farthest)} of {table.name.nunique()}" if len(farthest) < table.name.nunique() else "")
                   + f". Noise band: {bands}.", table, [plot])]
