"""The ``piezobench`` command: one file a group of verbs.

Whatever a user can get wrong is a sentence on standard error and exit status 2, without a traceback; exit status 1 is
left to what is wrong with the program itself.
"""

from __future__ import annotations

import sys

import typer

from bench.cli import race_verbs, stage_verbs
from bench.store import RunError
from piezo_model import IdentificationError, ModelError, StructureError
from piezo_model.recordings import RecordingError

USER_ERRORS = (RunError, IdentificationError, ModelError, StructureError, RecordingError)

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None,
                  help="Race quadratic-program solvers on piezo identification, and compensate piezo actuators.")
race_verbs.register(app)
stage_verbs.register(app)


def main() -> None:
    """Run the command line."""
    try:
        app()
    except USER_ERRORS as error:
        sys.exit(_refuse(str(error)))
    except OSError as error:
        sys.exit(_refuse(f"{error.filename}: {error.strerror}" if error.filename else str(error)))


def _refuse(sentence: str) -> int:
    print(f"piezobench: {sentence}", file=sys.stderr)
    return 2
