"""``report.html``: the report of a run as one page that stands alone."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.report.page import save
from bench.report.report import Report
from bench.store import Run


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


def write(run: Run, title: str, report: Report) -> Path:
    """Write ``report.html`` and ``figures/*.csv`` into the run's folder; returns the page's path."""
    pictures = [Picture.of(path) for path in sorted((run.path / "experiment").glob("*.svg"))]
    return save(run.path / "report.html", "report.html.jinja", report.drawn, title=f"{title} {run.path.name}", report=report,
                limits=limits(run, report), environment=environment(run.settings), pictures=pictures)


def limits(run: Run, report: Report) -> list[str]:
    """What the figures do not say, and what the machine was doing meanwhile."""
    settings = run.settings
    return [*report.limits, *settings["machine"]["warnings"], *settings.get("conditions", {}).get("warnings", [])]


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
