"""All verbs of ``piezobench``, and how a call is refused: one sentence on standard error, without a traceback.

A verb is a function in one of the files of this folder. Only the file of the requested verb is imported, since a race's
imports take seconds and ``piezobench --help`` needs none of them; the other verbs are only listed.
"""

import gc
import re
import signal
import sys
from collections.abc import Collection, Iterable
from importlib import import_module
from importlib.metadata import version as installed_version
from types import FrameType
from typing import Annotated

import typer

from bench.cli import INTERRUPTED, REFUSED, OutputError

VERBS = {
    "race": ("race_verbs", "Race solvers and compare their accuracy and speed."),
    "resume": ("race_verbs", "Continue an interrupted race."),
    "report": ("race_verbs", "Write the report of a run again and show its verdict."),
    "solvers": ("race_verbs", "List all solvers in all lanes, or why one is absent."),
    "problems": ("problem_verbs", "List the problem sets, or the problems of one set."),
    "certify": ("problem_verbs", "Prove the optimum of a program, and judge an answer."),
    "excite": ("recording_verbs", "Write a drive to record, for identification."),
    "inspect": ("recording_verbs", "Show how a recording is read."),
    "identify": ("model_verbs", "Identify a model of hysteresis and creep from a recording."),
    "validate": ("model_verbs", "Check a model against another recording."),
    "simulate": ("model_verbs", "Compute the output of a model for a drive."),
    "compensate": ("model_verbs", "Compute the drive with which a stage follows a reference."),
    "verify": ("run_verbs", "Judge every stored answer of a run again."),
    "compare": ("run_verbs", "Compare the times and accuracies of runs."),
    "deploy": ("run_verbs", "Choose the solver for a controller, and say why."),
    "export-c": ("export_verbs", "Write the compensator as C99 for a controller."),
    "export-fmu": ("export_verbs", "Write the compensator as an FMU for Co-Simulation."),
    "realtime": ("export_verbs", "Run the exported C in real time and count missed deadlines."),
    "live": ("live_verbs", "Run a compensator on a stage, and watch it learn."),
}
"""Verbs in the order of ``--help``, with their files and descriptions; ``export-c`` is the function
``export_c_verb``."""
PACKAGES = ("bench", "piezo_model", "solvers")
AGAIN_S = 3.0
"""Seconds after which a KeyboardInterrupt without effect is raised again."""
_received: list[int] = []
"""Signals received that end the program."""


def command_line(imported: Collection[str] = tuple(VERBS)) -> typer.Typer:
    """The command line with these verbs imported; the others are only listed."""
    app = typer.Typer(
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        help="Race quadratic-program solvers on piezo identification, and compensate piezo actuators.",
    )
    app.callback()(_options)
    for verb, (file, description) in VERBS.items():
        name = f"{verb.replace('-', '_')}_verb"
        function = getattr(import_module(f"bench.cli.{file}"), name) if verb in imported else lambda: None
        app.command(verb, short_help=description)(function)
    return app


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"piezobench {installed_version('piezobench')}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and end.")
    ] = False,
) -> None:
    """Options before the verb."""


def run(words: list[str]) -> int:
    """Run a command given as a list of words; returns the exit status.

    SIGINT, SIGTERM and SIGHUP end it by an exception, so that its child processes and temporary files are removed.
    Those that are ignored at the start stay so: SIGHUP under nohup, SIGINT in a background job.
    """
    verb = next((f" {name}" for name in words[:1] if name in VERBS), "")
    if other := [word for word in words if not word.isascii() and word != word.encode("utf-8", "replace").decode()]:
        return _refuse(verb, f"{other[0]} is not text in UTF-8, in which names of files are stored")
    status = _do(words, verb)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    try:
        sys.stdout.flush()
    except OutputError as error:
        return status or _refuse(verb, str(error))
    return 128 + _received[0] if _received else status


def _do(words: list[str], verb: str) -> int:
    try:
        verbs = command_line(words[:1])
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, _interrupt)
        return verbs(words or ["--help"], prog_name="piezobench", standalone_mode=False) or 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except typer.TyperException as error:  # a wrong verb, option or argument
        sentence = error.format_message().rstrip(".").replace("Value error, ", "")  # Pydantic's own words
        return _refuse(verb, f"{sentence}; see piezobench{verb} --help")
    except OSError as error:
        reason = error.strerror or str(error)
        return _refuse(verb, f"{error.filename}: {reason}" if error.filename else reason)
    except Exception as error:
        from solvers import Unsupported

        # a user's mistake, as all of our own exceptions are that are a ValueError; its message is one sentence
        if type(error).__module__.partition(".")[0] in PACKAGES and isinstance(
            error, ValueError | Unsupported | OutputError
        ):
            return _refuse(verb, as_typed(str(error), words))
        raise


def as_typed(sentence: str, words: Iterable[str]) -> str:
    """A sentence that names the argument of a function, with the option in its place if it is among the words."""
    for option in (word.partition("=")[0] for word in words if re.match("--[a-z]+-", word)):
        sentence = re.sub(rf"\b{option[2:].replace('-', '_')}(?= must be )", option, sentence)
    return sentence


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, and again later if it had no effect: a library may swallow it at import or in a callback
    of the garbage collector."""
    if number != signal.SIGALRM:
        _received.append(number)
        # closing a terminal sends two signals; the second one must not cut the clean-up short
        if number != signal.SIGINT:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            signal.signal(signal.SIGHUP, signal.SIG_IGN)
    collecting = frame is not None and frame.f_code in [
        getattr(callback, "__code__", None) for callback in gc.callbacks
    ]
    signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.001 if collecting else AGAIN_S)
    if not collecting and (number != signal.SIGALRM or not _is_handled()):
        raise KeyboardInterrupt


def _is_handled() -> bool:
    """Whether a KeyboardInterrupt is being handled now."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _refuse(verb: str, sentence: str) -> int:
    from bench.rendering import terminal

    print(terminal(f"piezobench{verb}: {' '.join(sentence.split())}"), file=sys.stderr)
    return REFUSED
