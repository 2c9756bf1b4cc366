"""The verb ``experiment``: the paper's Fig. 4 on a simulated stage."""

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.options import Seed, SolverName
from bench.report.console import AsJson, lines_of, print_report, progress_bar
from bench.stage.setup import StageSetup

FOLDER = Path("results/experiment")


def experiment_verb(
    out: Annotated[Path, typer.Option(help="Folder for the report, the figures and their data.")] = FOLDER,
    quick: Annotated[
        bool, typer.Option("--quick", help="Shorten the phases to seconds, with less exact results.")
    ] = False,
    seed: Seed = 0,
    solver: SolverName = "projected_difference",
    as_json: AsJson = False,
) -> None:
    """Let a simulated stage learn while it moves, and draw the result."""
    from bench.experiment.experiment import run  # the plot library is slow to load

    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is not a folder", param_hint="--out")
    setup = (StageSetup.quick if quick else StageSetup)(seed=seed, solver=solver)
    with progress_bar() as progress:
        report, written = run(out, setup, progress)
    page = written.with_suffix(".html")
    print_report(
        report,
        {"report": written, "page": page, **report.document},
        as_json,
        ["", *lines_of(report.notes)],
        [f"Page: {page}", f"Report: {written}"],
    )
