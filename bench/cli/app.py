"""The verbs of ``piezobench`` together, and how it refuses: one sentence on standard error, without a traceback."""

from __future__ import annotations

import sys

import typer

from bench.cli import decision_verbs, experiment_verbs, export_verbs, problem_verbs, race_verbs, stage_verbs
from bench.export.settings import ExportError
from bench.problem_files import ProblemFileError
from bench.problems import ProblemSetError
from bench.races.race import RaceError
from bench.store import RunError
from piezo_model import IdentificationError, ModelError, StructureError
from piezo_model.recordings import RecordingError
from solvers import Unsupported
from solvers.registry import RegistrationError

USER_ERRORS = (RaceError, RunError, ProblemSetError, ProblemFileError, IdentificationError, ModelError, StructureError,
               RecordingError, RegistrationError, ExportError, Unsupported)
REFUSED = 2
"""Exit status for what a user can put right; 1 is left to what is wrong with the program itself."""

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
                  help="Race quadratic-program solvers on piezo identification, and compensate piezo actuators.")
race_verbs.register(app)
problem_verbs.register(app)
stage_verbs.register(app)
decision_verbs.register(app)
experiment_verbs.register(app)
export_verbs.register(app)


def run(words: list[str]) -> int:
    """Do what the words of the command line say; returns the exit status."""
    verb = next((f" {name}" for name in words[:1] if not name.startswith("-")), "")
    try:
        return app(words or ["--help"], prog_name="piezobench", standalone_mode=False) or 0
    except typer.TyperException as error:  # usage: an option, an argument or a verb that is wrong
        sentence, known = error.format_message(), verb.strip() in {command.name for command in app.registered_commands}
        verb = verb if known else ""
        return _refuse(verb, f"{sentence.rstrip('.')}; see piezobench{verb} --help")
    except USER_ERRORS as error:
        return _refuse(verb, str(error))
    except OSError as error:
        reason = error.strerror or str(error)
        return _refuse(verb, f"{error.filename}: {reason}" if error.filename else reason)


def _refuse(verb: str, sentence: str) -> int:
    print(f"piezobench{verb}: {' '.join(sentence.split())}", file=sys.stderr)
    return REFUSED
