"""Pages that stand alone: one HTML file with its plots, tables, style and script in it, and each plot's data as CSV beside it.

Everything comes through templates that escape whatever they are handed, plots as JSON in which no markup survives. The page
forbids itself the network by its own content security policy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import altair as alt
import pandas as pd

from bench.rendering import html_templates
from bench.report import charts
from piezo_model.atomic_file import replacing, write_text


@dataclass(frozen=True)
class Figure:
    """One plot or several of the same data.

    Attributes
    ----------
    name : str
        Of the file of its data.
    title : str
    definition : str
        What is drawn and how it is defined, in sentences.
    data : DataFrame
        Everything that is drawn.
    plots : sequence of charts
    """

    name: str
    title: str
    definition: str
    data: pd.DataFrame
    plots: Sequence[alt.TopLevelMixin]

    @property
    def specifications(self) -> list[dict[str, Any]]:
        """What the page's script draws."""
        return [charts.specification(plot) for plot in self.plots]


@dataclass(frozen=True)
class Cell:
    """Text of a cell, and what it is sorted by."""

    text: str
    key: str | float = ""


@dataclass(frozen=True)
class Grid:
    """A table that can be sorted and filtered.

    Attributes
    ----------
    title : str
    headings : sequence of str
    rows : sequence of sequences of Cell
    left : int
        Columns of names, aligned to the left.
    filters : sequence of str
        Headings of the columns that have a choice of their values above the table.
    """

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    left: int = 1
    filters: Sequence[str] = ()
    note: str = ""
    choices: dict[str, list[str]] = field(init=False)

    def __post_init__(self) -> None:
        found = {}
        for heading in self.filters:
            column = list(self.headings).index(heading)
            found[heading] = sorted({row[column].text for row in self.rows})
        object.__setattr__(self, "choices", {heading: texts for heading, texts in found.items() if len(texts) > 1})

    @classmethod
    def of_text(cls, title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], left: int,
                filters: Sequence[str] = (), note: str = "") -> Grid:
        """Make the table of cells that are text and nothing more; the script sorts by the numbers they begin with."""
        return cls(title, headings, [[Cell(text, text) for text in row] for row in rows], left,
                   [name for name in filters if name in headings], note)


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
