"""Pages that stand alone: one HTML file with its plots, tables, style and script in it, and each plot's data as CSV beside it.

Everything comes through templates that escape whatever they are handed, plots as JSON in which no markup survives. The page
forbids itself the network by its own content security policy.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.rendering import html_templates
from bench.report import charts
from bench.report.report import Figure
from piezo_model.atomic_file import replacing, write_text


def save(path: Path, template: str, figures: Sequence[Figure], folder: str = "figures", **content: Any) -> Path:
    """Write the page, and ``<folder>/<name>.csv`` beside it for each figure; returns the page's path."""
    if figures:
        (path.parent / folder).mkdir(exist_ok=True)
    for figure in figures:
        with replacing(path.parent / folder / f"{figure.name}.csv") as temporary:
            figure.data.to_csv(temporary, index=False)
    text = html_templates("bench.report").get_template(template).render(
        figures=figures, folder=folder, library=charts.library() if figures else "", **content)
    write_text(path, text)
    return path
