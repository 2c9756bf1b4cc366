"""The verbs of one recording applied to many: the job on each, the table of all, and the first screen."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import as_typed
from bench.cli.options import WORKERS, check_option, refuse
from bench.fleet import fleet
from bench.fleet.jobs import Identifying, Job
from bench.processes.engine import Workers, started
from bench.report.console import lines_of, print_result, progress_bar, resumable
from piezo_model.recordings import RecordingError

OutDir = Annotated[
    str | None,
    typer.Option(
        "--out-dir",
        metavar="FOLDER",
        help="For many recordings: folder for the result of each and for a table of all. Results "
        "that already exist, of the same content and settings, are kept; others of the same name are replaced, and "
        "nothing is deleted.",
    ),
]
MOST_REFUSED = 12
"""Most lines about refused recordings on the first screen."""


def only(context: typer.Context, recordings: Sequence[str], out_dir: str | None) -> None:
    """Refuse several recordings in a call without --out-dir, and options for many."""
    check_option(
        out_dir is None and len(recordings) < 2, "--out", "is for one result, and --out-dir for one of each recording"
    )
    refuse(context, WORKERS, "is for many recordings, with --out-dir")


def process(
    job: Job,
    recordings: Sequence[str],
    out_dir: str | None,
    workers: Workers,
    what: str,
    as_json: bool,
    page: Path | None = None,
) -> None:
    """Do the job on all recordings, write the table, and show what it says; then RecordingError if any was refused."""
    if out_dir is None:
        raise typer.TyperException(
            "Missing option '--out'"
            if len(recordings) < 2
            else "Missing option '--out' for one model of all, or '--out-dir' for one of each recording"
            if isinstance(job, Identifying)
            else "Missing option '--out-dir' for one of each recording"
        )
    check_option(page is None, "--page", "is for one recording")
    workers.check()
    out = fleet.local(out_dir)
    items = fleet.items_of(job, recordings, out)
    out.mkdir(parents=True, exist_ok=True)
    with (
        resumable(out_dir, "finished recordings are kept; run the same command to continue", RecordingError),
        progress_bar() as progress,
        started(workers) as map_unordered,
    ):
        options = [f"--{name.replace('_', '-')}" for name in vars(job) | getattr(job, "options", {})]
        rows = [
            {**row, "refused": as_typed(row["refused"], options)}
            for row in fleet.run_all(items, map_unordered, progress)
        ]
        table, others = fleet.write_table(out, rows), fleet.products_of_others(job, rows, out)
    refused = table[table.refused != ""]
    reasons = lines_of(refused.refused)
    if len(reasons) > MOST_REFUSED:
        reasons = [*reasons[:MOST_REFUSED], "… and more in the table."]
    sentences = fleet.sentences(table, what, others)
    lines = [*lines_of(sentences), *(["Refused:", *reasons] if reasons else []), f"Table: {out_dir}/fleet.csv"]
    print_result(
        {
            "out_dir": out_dir,
            "sentences": sentences,
            "rows": table.to_dict("records"),
            "not_of_this_run": others,
        },
        as_json,
        *lines,
    )
    if len(refused):
        raise RecordingError(
            f"{len(refused)} of {len(table)} recordings {'is' if len(refused) == 1 else 'are'} refused; the table "
            f"{out_dir}/fleet.csv says why"
        )
