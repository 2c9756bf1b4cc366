"""Charts as SVG files beside a report in Markdown: of a fixed width, in dark ink on white, without what needs a pointer."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import altair as alt
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
    choices: dict[str, Any] = {}  # belong to the whole drawing; they have their first values here
    for part in parts:
        own = part.pop("params", [])
        part["params"] = [param for param in own if "select" in param]
        choices |= {param["name"]: {"name": param["name"], "value": param["value"]} for param in own if "select" not in param}
    config = {**charts.CONFIG, "background": "white", "aria": False, "font": "sans-serif"}
    found = {"vconcat": parts, "title": title, "params": [*choices.values()], "config": config}
    drawn: str = vl_convert.vegalite_to_svg(
        json.dumps(found).replace(charts.INK, INK), vl_version=charts.vega_lite_version(), allowed_base_urls=[])
    numbers: dict[str, int] = {}  # Vega counts its clip paths on through a process; the same chart shall be the same file
    return re.sub(r'(id="|url\(#)clip(\d+)', lambda found: f"{found[1]}clip{numbers.setdefault(found[2], len(numbers))}", drawn)


def write(shown: Sequence[alt.TopLevelMixin], path: Path, title: str = "") -> None:
    """Write the file, whole or not at all."""
    write_text(path, text(shown, title))
