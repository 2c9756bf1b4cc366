"""A report as files: a page that stands alone, Markdown with pictures beside it, the data of each figure as CSV.

Everything comes through templates that escape whatever they are handed, plots as JSON in which no markup survives. The
page has its plots, tables, style and script in it, and forbids itself the network by its own content security policy.
"""

from pathlib import Path

from bench.rendering import html_templates, markdown_templates
from bench.report import vega
from bench.report.report import Report
from piezo_model.atomic_file import replacing, write_text


def write_page(report: Report, path: Path, figures: str = "figures") -> Path:
    """Write the page, and ``<figures>/<name>.csv`` beside it for each figure; returns the page's path."""
    for figure in report.drawn:
        (path.parent / figures).mkdir(exist_ok=True)
        with replacing(path.parent / figures / f"{figure.name}.csv") as temporary:
            figure.data.to_csv(temporary, index=False)
    plots = {figure.name: [vega.specification(figure.data, plot) for plot in figure.plots] for figure in report.drawn}
    write_text(
        path,
        html_templates("bench.report")
        .get_template("page.html.jinja")
        .render(report=report, plots=plots, folder=figures, library=vega.library() if plots else ""),
    )
    return path


def write_markdown(report: Report, path: Path, pictures: int = 1) -> Path:
    """Write the report in Markdown, and as SVG beside it the first so many figures; returns its path."""
    for figure in report.drawn[:pictures]:
        write_text(path.parent / f"{figure.name}.svg", vega.svg(figure.data, figure.plots))
    write_text(
        path,
        markdown_templates("bench.report")
        .get_template("report.md.jinja")
        .render(report=report, pictures=report.drawn[:pictures]),
    )
    return path


def write_report(report: Report, folder: Path, name: str = "report", pictures: int = 1) -> Path:
    """Write ``<name>.html`` and ``<name>.md`` with what lies beside them, and ``summary.csv`` where there is one;
    returns the path of the second."""
    if report.summary is not None:
        with replacing(folder / "summary.csv") as temporary:
            report.summary.to_csv(temporary, index=False)
    write_page(report, folder / f"{name}.html")
    return write_markdown(report, folder / f"{name}.md", pictures)
