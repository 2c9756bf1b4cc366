"""``report.html``: the report of a run as one page, from the same figures as ``report.md``; a plot without data is left out."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import altair as alt
import pandas as pd

from bench.report.markdown import Report
from bench.report.page import Figure, Grid, save
from bench.store import Run


@dataclass(frozen=True)
class Content:
    """What a kind of race puts on the page of a run."""

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


def write(run: Run, title: str, content: Content) -> Path:
    """Write ``report.html`` and ``figures/*.csv`` into the run's folder; returns the page's path."""
    settings = run.settings
    pictures = sorted((run.path / "experiment").glob("*.svg"))
    conditions = settings.get("conditions", {}).get("warnings", [])
    return save(run.path / "report.html", "report.html.jinja", content.figures, title=f"{title} {run.path.name}",
                sentences=content.sentences, tables=content.tables, definitions=content.definitions,
                limits=["One machine, one run: compare ratios, not microseconds.", *settings["machine"]["warnings"],
                        *conditions],
                environment=environment(settings), pictures=[Picture.of(path) for path in pictures])


def environment(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Machine, versions and settings as names and texts."""
    machine = settings["machine"]
    field = ", ".join(f"{name} {version}" for name, version in settings.get("field", {}).items())
    absent = ", ".join(settings.get("absent", {}))
    left_out = "; ".join(f"{name}/{problem}: {why}" for name, found in settings.get("left_out", {}).items() for problem, why in found.items())
    chosen = ", ".join(f"{name} {_said(value)}" for name, value in settings["settings"].items() if value not in ([], None))
    return [(name, text) for name, text in (
        ("machine", f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"),
        ("Python", f"{machine['python']}; " + ", ".join(f"{name} {v}" for name, v in machine["versions"].items())),
        ("settings", chosen), ("solvers", field), ("absent", absent), ("not raced", left_out)) if text]


def _said(value: Any) -> str:
    if isinstance(value, list | dict):
        items = value.items() if isinstance(value, dict) else ((None, item) for item in value)
        return "(" + ", ".join(f"{name} {item}" if name else str(item) for name, item in items) + ")"
    return str(value)


def figure(name: str, title: str, definition: str, data: pd.DataFrame,
           draw: Callable[[pd.DataFrame], list[alt.TopLevelMixin]]) -> list[Figure]:
    """The figure, or none where there is nothing to draw."""
    return [Figure(name, title, definition, data, draw(data))] if len(data) else []


def grids(report: Report) -> list[Grid]:
    """The tables of a report, sorted and filtered at will."""
    return [Grid.of_text(table.title, table.headings, table.rows, table.left, ("lane", "tier", "status", "pace"))
            for table in report.tables]
