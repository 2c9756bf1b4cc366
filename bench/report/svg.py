"""Charts as SVG files beside a report in Markdown: of a fixed width, in dark ink on white, without what needs a pointer."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import altair as alt
import pandas as pd
import vl_convert

from bench.report import charts
from piezo_model.atomic_file import write_text

WIDTH = 780
INK = "#222222"


def text(shown: Sequence[alt.TopLevelMixin], title: str = "") -> str:
    """The charts under each other as SVG; those over the whole width of their page are ``WIDTH`` pixels wide."""
    parts = [chart.to_dict() for chart in shown]
    for part in parts:
        if part.get("width") == "container":
            part["width"] = WIDTH
    found = {"vconcat": parts, "title": title, "config": {**charts.CONFIG, "background": "white", "font": "sans-serif"}}
    drawn: str = vl_convert.vegalite_to_svg(
        json.dumps(found).replace(charts.INK, INK), vl_version=charts.vega_lite_version(), allowed_base_urls=[])
    numbers: dict[str, int] = {}  # Vega counts its clip paths on through a process; the same chart shall be the same file
    return re.sub(r'(id="|url\(#)clip(\d+)', lambda found: f"{found[1]}clip{numbers.setdefault(found[2], len(numbers))}", drawn)


def write(shown: Sequence[alt.TopLevelMixin], path: Path, title: str = "") -> None:
    """Write the file, whole or not at all."""
    write_text(path, text(shown, title))


def write_first_view(table: pd.DataFrame, draw: Callable[[pd.DataFrame], list[alt.TopLevelMixin]], path: Path) -> None:
    """Write the view of a table that its page shows first, with the name of the view as title; a table may be empty."""
    view = charts.first_view(table)
    write(draw(table[table["view"] == view]), path, view)
