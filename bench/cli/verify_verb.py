"""The verb ``verify``: judge the answers that are stored in a run again."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from bench.races.kind import open_run
from bench.report.console import AsJson, print_result, progress_bar
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
