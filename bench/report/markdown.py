"""A report as Markdown, with its picture as SVG and its summary as CSV beside it."""

from __future__ import annotations

from pathlib import Path

from bench.rendering import markdown_templates
from bench.report import charts, svg
from bench.report.race_page import environment, limits
from bench.report.report import Report
from bench.store import Run
from piezo_model.atomic_file import replacing, write_text


def write(run: Run, title: str, report: Report) -> Path:
    """Write ``summary.csv``, the picture and ``report.md``; returns the report's path."""
    with replacing(run.path / "summary.csv") as temporary:
        report.summary.to_csv(temporary, index=False)
    pictures = report.drawn[:1]
    for figure in pictures:
        svg.write(figure.plots, run.path / f"{figure.name}.svg", charts.first_view(figure.data))
    text = markdown_templates("bench.report").get_template("race.md.jinja").render(
        title=f"{title} {run.path.name}", report=report, pictures=pictures, limits=limits(run, report), environment=environment(run.settings))
    write_text(run.path / "report.md", text)
    return run.path / "report.md"
