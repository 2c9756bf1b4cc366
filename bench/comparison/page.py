"""Comparisons of runs as one page, as Markdown, and as JSON for machines."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import altair as alt
import numpy as np
import pandas as pd

from bench.comparison import tiers
from bench.comparison.compare import RunComparison
from bench.comparison.lines import CANNOT_TELL, LINE, SAME, UNLIMITED
from bench.derived.ranking import ASKED
from bench.rendering import markdown_templates
from bench.report import charts
from bench.report.console import plain_json
from bench.report.page import save
from bench.report.report import Figure, Table
from bench.report.words import OURS_NOTE, marked, settings_label
from piezo_model.atomic_file import write_text
from piezo_model.json_file import decoded
from solvers import Tier

FORMAT, VERSION = "piezobench-comparison", 3
LINE_HEADINGS = ("solver", "lane", "times", "finding", "ratio", "interval", "smallest visible", "repeats needed", "rows", "adjusted p")
HEADINGS = ("solver", "lane", "change", "ratio", "interval", "problem set", "problem", "scaling", "start", "setting",
            "adjusted p", "cost gaps", "statuses")
TIER_HEADINGS = ("solver", "lane", "change", "tier", "scaling", "setting of the first run", "setting of the second run")
LINE_COLUMNS = [*LINE, "rows", "finding", "ratio", "ratio_low", "ratio_high", "shown", "repeats", "p", "adjusted"]
MOST_LINES = 40
"""Solver lanes whose ratios are drawn."""
COLOURS = {"slower": "#d55e00", "faster": "#009e73", CANNOT_TELL: "#cc79a7", SAME: "#999999"}
SHAPES = ("triangle-right", "triangle-left", "diamond", "circle")
TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.5, 2, 3, 5, 10, 20, 50, 100]
DEFINITIONS = (
    "ratio: update and solve in the second run over the first, by medians; in turns with the other solvers where both runs have such times, "
    "hot otherwise. What the field as a whole changed by, its median at the same moment, is taken for the machine's and divided out.",
    "Each solver lane is one hypothesis: its ratio is the mean over problems without the largest and the smallest fifth.",
    "interval: 95 %, by Student's distribution, from the spread over problems and between processes. The latter is estimated from the "
    "solver lanes that did not change, and from repeats where there are some.",
    "smallest visible: the smallest change that these two runs would have shown nine times in ten. Where it is above the one that matters, and "
    "nothing was found, the finding is 'cannot tell'.",
    "repeats needed: --repeats in both runs with which the smallest change that matters would show, if noise falls as with fresh processes.",
    "adjusted p: corrected for the number of solver lanes (Benjamini and Hochberg). A lane is faster or slower where it is below 5 %, and only "
    "then are its rows tested.",
    "more or less accurate: the exact cost gap differs by more than a factor of 10 and the larger one is above 1e-12.",
    "Rows are compared at the same setting. One that one of the runs did not run, since a looser setting failed or took too long, is not.",
    "lost, gained: a tier for which a solver lane has a setting that is right on every problem in one of the runs only. By chance: only its "
    "timed answers, on data that each run draws anew, or a call near 0.1 s, made the difference, and no oftener than by chance.",
    "A regression is a solver lane that became slower, a row that became less accurate, is gone, or had an answer and no longer has, or a tier "
    "that was lost otherwise than by chance.",
    OURS_NOTE)


def write(comparisons: Sequence[RunComparison], folder: Path) -> Path:
    """Write ``comparison.html``, ``.md``, ``.json`` and the data of the plots; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "comparison.json", json.dumps(to_dict(comparisons), indent=1, allow_nan=False) + "\n")
    content: dict[str, Any] = {
        "title": "Comparison of " + ", ".join([comparisons[0].a.path.name, *(each.b.path.name for each in comparisons)]),
        "comparisons": comparisons, "grids": [table for each in comparisons for table in (line_grid(each), tier_grid(each), grid(each))],
        "definitions": DEFINITIONS}
    write_text(folder / "comparison.md", markdown_templates("bench.report").get_template("comparison.md.jinja").render(**content))
    figures = [figure for i, each in enumerate(comparisons) for figure in ratios(each, i)]
    return save(folder / "comparison.html", "comparison.html.jinja", figures, **content)


def to_dict(comparisons: Sequence[RunComparison]) -> dict[str, Any]:
    """Everything as JSON can hold it; null stands for what is not known."""
    found: dict[str, Any] = plain_json({"format": FORMAT, "version": VERSION, "baseline": str(comparisons[0].a.path), "comparisons": [
        {"run": str(each.b.path), "warnings": list(each.warnings), "notes": [*each.doubts, *each.notes], "verdict": each.verdict,
         "difference": bool(each.differences), "regressions": each.regressions, "cannot_tell": each.cannot_tell,
         "smallest": each.times.smallest, "machine": each.times.machine,
         "lines": each.times.lines[LINE_COLUMNS].to_dict("records"), "tiers": each.tiers.to_dict("records"),
         "rows": each.rows.to_dict("records")}
        for each in comparisons]})
    return found


def line_grid(comparison: RunComparison, told: bool = True) -> Table:
    """Solver lanes, those that differ first, then those of which nothing can be told, then those told not to differ unless left out."""
    lines = comparison.times.lines
    lines = lines if told else lines[lines.finding != SAME]
    ordered = lines.assign(order=lines.finding.map(list(COLOURS).index)).sort_values(["order", "p"])
    rows = [[marked(line["solver"]), line["lane"], line["timed"], line["finding"], f"{line['ratio']:.3f}",
             f"{line['ratio_low']:.3f} to {line['ratio_high']:.3f}" if line["shown"] < UNLIMITED else "unknown",
             f"{line['shown']:.2f}" if line["shown"] < UNLIMITED else "nothing", str(line["repeats"]), str(line["rows"]), f"{line['adjusted']:.1e}"]
            for line in cast(list[dict[str, Any]], ordered.to_dict("records"))]
    return Table(f"Solver lanes: {comparison.b.path.name} against {comparison.a.path.name}", LINE_HEADINGS, rows, 4,
                ("lane", "times", "finding"))


def tier_grid(comparison: RunComparison, other: bool = True) -> Table:
    """The tiers that were lost, then those that were gained, then those with another setting unless left out."""
    changed = comparison.tiers[comparison.tiers.change.isin([tiers.LOST, tiers.GAINED, *([tiers.OTHER] if other else [])])]
    words = setting_words(comparison)
    rows = [[marked(row["solver"]), row["lane"], row["change"] + (" by chance" if row["by_chance"] else ""), ASKED[Tier(row["tier"])], row["scaling"],
             *(words.get((row["solver"], row["lane"], row[name]), "–") for name in ("setting_a", "setting_b"))]
            for change in (tiers.LOST, tiers.GAINED, tiers.OTHER)
            for row in cast(list[dict[str, Any]], changed[changed.change == change].sort_values("by_chance", kind="stable").to_dict("records"))]
    return Table(f"Tiers that differ: {comparison.b.path.name} against {comparison.a.path.name}", TIER_HEADINGS, rows, 5,
                 ("lane", "change", "tier", "scaling"))


def grid(comparison: RunComparison) -> Table:
    """The rows that changed, the worst first."""
    changed = comparison.changed.sort_values(["regression", "ratio"], ascending=[False, False])
    words = setting_words(comparison)
    rows = [_cells(row, words) for row in cast(list[dict[str, Any]], changed.to_dict("records"))]
    return Table(f"Rows that differ: {comparison.b.path.name} against {comparison.a.path.name}", HEADINGS, rows, 3,
                ("lane", "change"))


def setting_words(comparison: RunComparison) -> dict[tuple[str, str, str], str]:
    """What a setting has that others of the same solver lane have not, by solver, lane and setting."""
    who, found = ["solver", "lane", "setting"], comparison.tiers
    every = pd.concat([comparison.rows[who], *(found.rename(columns={name: "setting"})[who] for name in ("setting_a", "setting_b"))])
    words: dict[tuple[str, str, str], str] = {}
    for (solver, lane), part in every[every.setting != ""].groupby(["solver", "lane"]):
        known = {text: decoded(text, dict[str, Any]) for text in part.setting.unique()}
        shared = set.intersection(*({*map(str, settings.items())} for settings in known.values())) if len(known) > 1 else set()
        words |= {(str(solver), str(lane), text): settings_label(dict(item for item in settings.items() if str(item) not in shared)) or "default"
                  for text, settings in known.items()}
    return words


def _cells(row: Mapping[str, Any], words: Mapping[tuple[str, str, str], str]) -> list[str]:
    names = (row["problem_set"], row["problem"], row["scaling"], row["start"], words[row["solver"], row["lane"], row["setting"]])
    low, high = (_number(row[f"ratio_{end}"], ".3f") for end in ("low", "high"))
    statuses = (row["status_a"] or "–", row["status_b"] or "–")
    return [marked(row["solver"]), row["lane"], ", ".join(row["changes"]), _number(row["ratio"], ".3f"), f"{low} to {high}", *names,
            _number(row["adjusted"], ".1e"), f"{_number(row['gap_a'], '.1e')}, {_number(row['gap_b'], '.1e')}",
            statuses[0] if statuses[0] == statuses[1] else " → ".join(statuses)]


def _number(value: float, how: str) -> str:
    return "–" if pd.isna(value) else format(value, how)


def ratios(comparison: RunComparison, number: int) -> list[Figure]:
    """Ratios of the solver lanes with their intervals, and of their rows; nothing where no times can be compared."""
    lines = comparison.times.lines
    if lines.empty:
        return []
    table = lines.assign(name=lines.solver.map(marked) + " (" + lines.lane + ", " + lines.timed + ")")[["name", *LINE_COLUMNS]]
    shown = table.loc[np.log(table.ratio).abs().sort_values(ascending=False, kind="stable").index[:MOST_LINES]]
    rows = comparison.rows[comparison.rows.ratio.notna()]
    rows = rows.assign(name=rows.solver.map(marked) + " (" + rows.lane + ", " + rows.timed + ")")[["name", "problem", "scaling", "setting", "ratio"]]
    rows = rows[rows.name.isin(shown.name)]
    y = alt.Y("name:N", title=None, sort=list(shown.name), axis=alt.Axis(labelLimit=240))
    low, high = min(0.8, rows.ratio.min(), shown.ratio.min()), max(1.25, rows.ratio.max(), shown.ratio.max())
    x = alt.X("ratio:Q", title="second run over first", axis=alt.Axis(values=TICKS, format="~g"),
              scale=alt.Scale(type="log", nice=False, domain=[low, high], clamp=True))
    colour = alt.Color("finding:N", scale=alt.Scale(domain=[*COLOURS], range=[*COLOURS.values()]), legend=alt.Legend(columns=2))
    tips = [alt.Tooltip(f"{name}:N") for name in ("name", "finding")] + [
        alt.Tooltip(f"{name}:Q", format=".3f") for name in ("ratio", "ratio_low", "ratio_high", "shown")]
    base = alt.Chart(charts.data(shown)).encode(y=y, color=colour, tooltip=tips)
    faint = alt.Chart(charts.data(rows)).mark_tick(color=charts.INK, opacity=0.25, thickness=1).encode(
        x=x, y=y, tooltip=[alt.Tooltip(f"{name}:N") for name in ("name", "problem", "scaling", "setting")] + [
            alt.Tooltip("ratio:Q", format=".3f")])
    intervals = base.mark_rule(strokeWidth=2).encode(x=alt.X("ratio_low:Q", title=None), x2="ratio_high:Q")
    points = base.mark_point(filled=True, size=60).encode(
        x=x, shape=alt.Shape("finding:N", scale=alt.Scale(domain=[*COLOURS], range=list(SHAPES))))
    same = alt.Chart(charts.data(pd.DataFrame({"same": [1.0]}))).mark_rule(strokeDash=[5, 4]).encode(x="same:Q")
    plot = charts.finished(alt.layer(same, faint, intervals, points), None, 40 + charts.ROW * len(shown))
    machine = ", ".join(f"{ratio:.2f} {timed}" for timed, ratio in comparison.times.machine.items())
    return [Figure(f"ratios_{number + 1}", f"Times of {comparison.b.path.name} over those of {comparison.a.path.name}",
                   "Each point is a solver lane with its interval, each faint line one of its rows, largest changes first"
                   + (f", {len(shown)} of {len(table)}" if len(shown) < len(table) else "")
                   + f". The field as a whole changed by {machine}, which is divided out.", table, [plot])]
