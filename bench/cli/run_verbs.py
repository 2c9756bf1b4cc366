"""Verbs for finished runs: ``verify`` judges the stored answers of one again, ``combine`` puts several side by side,
``history`` follows a solver through them."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from bench.cli import FAILED
from bench.comparison.asv import write_asv
from bench.comparison.compare import SMALLEST
from bench.comparison.several_runs import FOLLOWED, Combination, history, regressions, report
from bench.derived.measurements import Measurements
from bench.races.kind import open_run
from bench.report.console import AsJson, plain_json, print_report, print_result, progress_bar
from bench.report.report import Table
from bench.report.writing import write_report
from bench.store import RunError
from bench.verification import verify_run


def verify_verb(run: Annotated[Path, typer.Argument(help="Folder of the run.")], as_json: AsJson = False) -> None:
    """Judge every stored answer of a run again, from the data of its problems in exact arithmetic.

    It shows that accuracies follow from the stored answers; not who gave them, nor that times and statuses are true.
    """
    with progress_bar() as progress:
        found = verify_run(open_run(run), progress)
    if found.wrong:
        more = f", and {len(found.wrong) - 1} more" if len(found.wrong) > 1 else ""
        raise RunError(f"{run} does not agree with its answers: {found.wrong[0]}{more}")
    lines = [
        f"{found.rows} rows agree: {found.first} first and {found.timed} timed answers were judged again against "
        f"{found.proofs} replayed proofs, and give the stored gaps to the last bit."
    ]
    print_result(asdict(found), lines, as_json)


def combine_verb(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN_A RUN_B [RUN_C ...]", help="Folders of one-shot races.")],
    out: Annotated[Path, typer.Option(help="Folder for the report, which must be new.")],
    as_json: AsJson = False,
) -> None:
    """Put runs of several machines, instruction sets or versions side by side, on the problems that all of them have.

    Runs have the same problems if they are of the same sets and seed, or if one raced those of another by
    'race --folder RUN/problems'.
    """
    if len(runs) < 2:
        raise typer.BadParameter("two runs or more are combined", param_hint="RUN_A RUN_B")
    if out.exists():
        raise typer.BadParameter(f"{out} already exists; name a new folder", param_hint="--out")
    found = report(Combination.of([open_run(path) for path in runs]))
    out.mkdir(parents=True)
    page = write_report(found, out, "combined").with_suffix(".html")
    print_report(found, found.document, as_json, list(found.notes), ["", f"Page: {page}"])


def history_verb(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN_A RUN_B [...]", help="Folders of runs, oldest first.")],
    solver: Annotated[str, typer.Option(help="Name of the solver.")],
    most_iterations: Annotated[
        float, typer.Option(min=1.0, help=f"Exit with status {FAILED} if iterations grow by more than this ratio.")
    ] = 1.05,
    most_time: Annotated[
        float, typer.Option(min=1.0, help=f"Exit with status {FAILED} if times grow by more than this ratio.")
    ] = 1.25,
    asv: Annotated[
        Path | None, typer.Option(help="Folder of results of airspeed velocity (asv), to which the runs are added.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Follow a solver from run to run: iterations exactly, times by the rule of 'compare', each against the first run.

    --json prints the newest run as a list of names, units and values, smaller being better, as actions for continuous
    benchmarking read.
    """
    if len(runs) < 2:
        raise typer.BadParameter("a history has two runs or more", param_hint="RUN_A RUN_B")
    read = [open_run(path) for path in runs]
    measured = [Measurements.of(run) for run in read]
    table = history(read, measured, solver, SMALLEST)
    worse = regressions(table, most_iterations, most_time)
    if asv is not None:
        write_asv(read, measured, solver, asv)
    newest = [
        {
            "name": f"{solver} ({line['lane']}) {what}",
            "unit": "ratio",
            "value": line[f"{what}_ratio"],
            "extra": json.dumps(plain_json(line)),
        }
        for line in table[table.run == table.run.iloc[-1]].to_dict("records")
        for what in ("iterations", "time")
    ]
    shown = Table.of("", table, FOLLOWED)
    print_result(newest, worse, as_json, (shown.headings, shown.rows, 4))
    if worse:
        raise typer.Exit(FAILED)
