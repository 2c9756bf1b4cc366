"""The report of a run as Markdown, and its summary as CSV."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bench.rendering import markdown, markdown_templates
from bench.report import figures, plot_data, plots
from bench.store import Run
from piezo_model.atomic_file import replacing, write_text

HEADINGS = {"solver": "solver", "lane": "lane", "tier": "tier", "start": "start", "settings": "settings", "right": "right",
            "worst_cost_gap": "worst cost gap", "worst_primal_residual": "primal residual",
            "worst_dual_residual": "dual residual", "worst_weight_error": "weight error",
            "model_error_percent": "model error, %", "setup_us": "setup, µs", "update_us": "update, µs",
            "solve_us_p50": "solve p50, µs", "solve_us_p99": "p99", "solve_us_max": "max",
            "interleaved_us_p50": "interleaved p50", "periods": "periods",
            "status": "status"}


def cell(row: pd.Series, column: str) -> str:
    """One cell of the table as Markdown."""
    return markdown(text(row, column))


def text(row: pd.Series, column: str) -> str:
    """One cell of the table as plain text."""
    value = row[column]
    if column == "right":
        return "–" if row.status == figures.FLOOR else f"{row.right}/{row.problems}"
    if column == "settings":
        return settings_label(str(value))
    if isinstance(value, float):
        if pd.isna(value):
            return "–"
        return f"{value:.1e}" if "gap" in column or "residual" in column or "weight" in column else f"{value:.3g}"
    return str(value)


def settings_label(text: str) -> str:
    """Turn ``{"steps": 100}`` into ``steps 100``."""
    return text.strip("{}").replace('"', "").replace(":", "")


def render(run: Run) -> str:
    """The report's text."""
    rows = run.rows()
    table = figures.summary(rows)
    return markdown_templates("bench.report").get_template("report.md.jinja").render(
        name=run.path.name, settings=run.settings, sentences=figures.verdict(rows).sentences, headings=HEADINGS,
        parts=[(*names, [row for _, row in part.iterrows()])
               for names, part in table.groupby(["problem_set", "scaling"], sort=False)],
        problems=rows.drop_duplicates(["problem_set", "problem"])[["problem_set", "problem", "d"]].values.tolist(),
        failures=figures.failures(rows), cell=cell, sizes=plot_data.time_by_size(rows).to_dict("records"))


def write(run: Run) -> Path:
    """Write ``report.md``, ``summary.csv`` and the plots (with several sizes ``sizes.svg`` too) into the run's folder; the report's path."""
    with replacing(run.path / "summary.csv") as temporary:
        figures.summary(run.rows()).to_csv(temporary, index=False)
    plots.accuracy_against_time(run.rows(), run.path / "accuracy.svg")
    if len(by_size := plot_data.time_by_size(run.rows())):
        plots.time_against_size(by_size, run.path / "sizes.svg")
    write_text(run.path / "report.md", render(run))
    return run.path / "report.md"
