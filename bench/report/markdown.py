"""What a run says and shows, and that as Markdown with its summary as CSV beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bench.rendering import markdown_templates
from bench.store import Run
from piezo_model.atomic_file import replacing, write_text
from piezo_model.json_file import decoded

SHARED = "bench.report"
"""Has the template that those of the kinds of race build on."""


@dataclass(frozen=True)
class Table:
    """A table with its cells as text."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int
    """Columns of names, aligned to the left."""

    @property
    def records(self) -> list[dict[str, str]]:
        """Rows by their headings."""
        return [dict(zip(self.headings, row, strict=True)) for row in self.rows]


@dataclass(frozen=True)
class Report:
    """What is said and shown of a run: the verdict first, then tables."""

    sentences: Sequence[str]
    tables: Sequence[Table]
    figures: Sequence[Mapping[Any, Any]] | None = None
    """For machines, in place of the tables."""

    @property
    def document(self) -> dict[str, Any]:
        """Everything for machines."""
        shown = ({"rows": self.figures} if self.figures is not None else
                 {"tables": [{"title": table.title, "rows": table.records} for table in self.tables]})
        return {"verdict": self.sentences, **shown}


def write(run: Run, package: str, summary: pd.DataFrame, **content: Any) -> Path:
    """Write ``summary.csv`` and ``report.md`` from the template of a package; returns the report's path."""
    with replacing(run.path / "summary.csv") as temporary:
        summary.to_csv(temporary, index=False)
    write_text(run.path / "report.md", markdown_templates(package, SHARED).get_template("report.md.jinja").render(
        name=run.path.name, settings=run.settings, **content))
    return run.path / "report.md"


def settings_label(text: str) -> str:
    """Turn ``{"steps": 100, "eps": 1.23456e-9}`` into ``steps 100, eps 1.2e-09``."""
    settings = decoded(text, dict[str, Any]).items()
    return ", ".join(f"{name} {value:.2g}" if isinstance(value, float) else f"{name} {value}" for name, value in settings)


def number(value: float) -> str:
    """Three digits, and no powers of ten in what is thousands of microseconds."""
    return "–" if math.isnan(value) else f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def gap(value: float) -> str:
    """A relative cost gap."""
    return "–" if not math.isfinite(value) else f"{value:.1e}"
