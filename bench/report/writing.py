"""A report as files: a self-contained HTML page, Markdown with pictures beside it, and the data of each figure as CSV.

The templates escape every value, and plots are JSON without markup. The page contains its plots, tables, style and
script; its content security policy forbids network access.
"""

from pathlib import Path

import pandas as pd

from bench.rendering import markdown_templates, markup_templates
from bench.report import vega
from bench.report.report import Report
from piezo_model.atomic_file import replacing, write_text


def write_page(report: Report, path: Path, figures: str = "figures") -> Path:
    """Write the page, and ``<figures>/<name>.csv`` beside it for each figure; returns the page's path."""
    for figure in report.drawn:
        (path.parent / figures).mkdir(exist_ok=True)
        _write_csv(figure.data, path.parent / figures / f"{figure.name}.csv")
    plots = {figure.name: [vega.specification(figure.data, plot) for plot in figure.plots] for figure in report.drawn}
    write_text(
        path,
        markup_templates("bench.report")
        .get_template("page.html.jinja")
        .render(report=report, plots=plots, folder=figures, library=vega.library() if plots else ""),
    )
    return path


def write_report(report: Report, folder: Path, name: str = "report", pictures: int = 1) -> Path:
    """Write ``<name>.html``, ``<name>.md`` with the first ``pictures`` figures as SVG, their figures, and
    ``summary.csv`` if the report has a summary; returns the path of the Markdown file."""
    if report.summary is not None:
        _write_csv(report.summary, folder / "summary.csv")
    for file, save in report.files.items():
        (folder / file).parent.mkdir(exist_ok=True)
        save(folder / file)
    write_page(report, folder / f"{name}.html")
    for figure in report.drawn[:pictures]:
        write_text(folder / f"{figure.name}.svg", vega.svg(figure.data, figure.plots))
    path = folder / f"{name}.md"
    write_text(
        path,
        markdown_templates("bench.report")
        .get_template("report.md.jinja")
        .render(report=report, pictures=report.drawn[:pictures]),
    )
    return path


def _write_csv(table: pd.DataFrame, path: Path) -> None:
    with replacing(path) as temporary:
        table.to_csv(temporary, index=False)
