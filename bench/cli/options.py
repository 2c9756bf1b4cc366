"""Options that several verbs share, defined once, and the refusal of options that a call would ignore."""

import functools
import inspect
import math
import os
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.processes.engine import Backend, Workers
from piezo_model.model import StartChoice
from solvers import find
from solvers.exact.linear_algebra import WORK

Verb = Callable[..., None]


def grouped(group: str, options: Mapping[str, Any], make: Callable[..., Any] = dict) -> Callable[[Verb], Verb]:
    """Add options, given as annotations by name, to a verb, which receives in its parameter ``group`` what ``make``
    makes of their values; a settings class gives its defaults."""

    def decorate(verb: Verb) -> Verb:
        signature = inspect.signature(verb, eval_str=True)
        defaults = vars(make) if is_dataclass(make) else {}
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=defaults.get(name), annotation=kind)
            for name, kind in options.items()
        ]
        parameters = [*(parameter for name, parameter in signature.parameters.items() if name != group), *added]

        @functools.wraps(verb)
        def wrapped(**arguments: Any) -> None:
            made = make(**{name: arguments.pop(name) for name in options})
            verb(**arguments, **{group: made})

        wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate


def refuse(context: typer.Context, options: Container[str], why: str) -> None:
    """Refuse the call if one of these parameters of the verb is on the command line, even with its default value;
    ``why`` follows its name."""
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        if parameter.name in options and source is not None and source.name == "COMMANDLINE":
            raise typer.BadParameter(why, param_hint=parameter.opts[0])


def check_option(condition: bool, option: str, why: str) -> None:
    """Refuse a call that does not meet a condition; ``why`` follows the name of the option."""
    if not condition:
        raise typer.BadParameter(why, param_hint=option)


def check_apart(out: Path, option: str, others: Iterable[str | Path | None]) -> None:
    """Refuse an output that is another of the call's files or in one of its folders."""
    written = Path(os.path.realpath(out))
    for other in (path for path in others if path):
        read = Path(os.path.realpath(other))
        check_option(written != read, option, f"{out} is another file of this command; name a new one")
        check_option(
            not (read.is_dir() and written.is_relative_to(read)),
            option,
            f"{out} is in {other}, which this command reads; name a file elsewhere",
        )


def check_writable(out: Path | None, option: str = "--out", others: Iterable[str | Path | None] = ()) -> None:
    """Refuse an output file that cannot be written, or that is another of the call's files or in one of its folders,
    before the work starts."""
    if out is None:
        return
    check_apart(out, option, others)
    check_option(out.parent.is_dir(), option, f"the folder {out.parent} does not exist")
    check_option(  # writing would replace it, even /dev/null
        out.is_file() or not out.exists(),
        option,
        f"{out} is {'a folder' if out.is_dir() else 'not a regular file'}",
    )
    check_option(os.access(out.parent, os.W_OK), option, f"the folder {out.parent} is not writable")


def installed(name: str) -> str:
    """Callback of an option: the name of a registered solver whose library is installed."""
    try:
        find(name).load()
    except KeyError as error:
        raise typer.BadParameter(str(error.args[0])) from None
    except ImportError as error:
        raise typer.BadParameter(f"{name} is not installed here ({error})") from None
    return name


def positive(value: float | None) -> float | None:
    """Callback of an option: a positive finite number, or None if the option is not set."""
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"must be positive, not {value:g}")
    return value


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables and sentences.")]
SolverName = Annotated[
    str, typer.Option("--solver", metavar="NAME", callback=installed, help="Name of a registered solver.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of all random numbers.")]
RateLimit = Annotated[
    float | None,
    typer.Option(
        "--rate-limit", metavar="RATE", callback=positive, help="Largest change of the drive, input units per second."
    ),
]

WORKERS: dict[str, Any] = {
    "count": Annotated[
        int, typer.Option("--workers", metavar="N", min=1, help="Number of worker processes, each on its own core.")
    ],
    "backend": Annotated[Backend, typer.Option(help="Where the workers run.")],
    "scheduler": Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Address of a Dask scheduler whose workers see the same folder under this path."
        ),
    ],
}
on_workers = grouped("workers", WORKERS, Workers)
"""A verb that receives `bench.processes.engine.Workers`."""

FILE = "A recording in any known format; 'piezobench inspect' shows how it is read."
READING: dict[str, Any] = {
    "time": Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Time column: its name, a path such as group/channel, or its number counted from 1; 'none' if there "
            "is no clock. Guessed by default.",
        ),
    ],
    "sample_time": Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Sampling period in s, for a file without times.")
    ],
    "sample_rate": Annotated[
        float | None, typer.Option(metavar="HZ", help="Sampling rate in Hz, instead of --sample-time.")
    ],
    "header_row": Annotated[
        int | None, typer.Option(metavar="ROW", help="Row with the column names, counted from 1; 0 for no header.")
    ],
    "decimal": Annotated[
        str | None, typer.Option(metavar="MARK", help="Decimal mark of a text, '.' or ','; detected by default.")
    ],
    "table": Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Number or name of a table, if a file has several that can be the recording."
        ),
    ],
    "resample": Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Sampling period in s to interpolate to, if the times are not equidistant."
        ),
    ],
    "input_unit": Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of the input, such as V, if the file does not state it.")
    ],
    "output_unit": Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of the output, such as um, if the file does not state it.")
    ],
    "time_unit": Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of the times, such as ms, if the file does not state it.")
    ],
    "from_s": Annotated[
        float | None,
        typer.Option(
            "--from", metavar="SECONDS", help="Start reading so many seconds after the first time of each part."
        ),
    ],
    "to_s": Annotated[
        float | None,
        typer.Option("--to", metavar="SECONDS", help="Stop reading so many seconds after the first time of each part."),
    ],
    "decimate": Annotated[int | None, typer.Option(metavar="N", min=1, help="Read one row in N.")],
    "strict": Annotated[bool | None, typer.Option("--strict", help="Refuse a recording that needs repairs.")],
}
"""Options of ``read_reference``, for every verb that opens a file of signals."""
RECORDING = {
    "time": READING["time"],
    "input": Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Input column, such as voltage_V; of a recording in two files that of the input, as FILE "
            "or FILE:COLUMN.",
        ),
    ],
    "output": Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Output column, such as displacement_um; of a recording in two files that of the output.",
        ),
    ],
    **READING,
}
"""Options of ``Recording.open``."""
SET_OPTIONS = {
    "recording": Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Recording for the set recorded, in any known format; 'piezobench inspect' shows how it is read.",
        ),
    ],
    "folder": Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder of NPZ, MAT, QPS, MPS and SIF files, for the set foreign."),
    ],
    "test_set": Annotated[
        Path | None,
        typer.Option(metavar="FILE.py", help="Python file with a test set of qpbenchmark, for the set test_set."),
    ],
    "work": Annotated[
        float | None,
        typer.Option(
            metavar="OPERATIONS",
            min=1.0,
            help=f"Most bit operations of a proof, for the sets foreign and test_set; {WORK:.0e} by default.",
        ),
    ],
    **RECORDING,
}
"""Options of problem sets."""


_STATES = (
    "States before the first sample: of a stage that has settled (rest), or those that identify found before its "
    "recording (recording)"
)
Start = Annotated[StartChoice, typer.Option("--start", help=f"{_STATES}.")]
StartOfModel = Annotated[
    StartChoice | None, typer.Option("--start", help=f"{_STATES}; by default recording, if the model has them.")
]
STARTS = {
    "recording": "The stage begins in the states that identify found before its recording.",
    "rest": "The stage begins settled at {}.",
}
XStart = Annotated[
    float | None,
    typer.Option(
        "--x-start",
        metavar="X",
        help="Where the stage is before the first drive, in the input's unit; by default at rest, which is 0 or the "
        "limit nearest to 0.",
    ),
]
NoDynamics = Annotated[
    bool,
    typer.Option(
        "--no-dynamics", help="Take the static part of a model with dynamics; what is written carries a warning."
    ),
]


def opening(**values: Any) -> dict[str, Any]:
    """The options that are set, as keywords of ``Recording.open``, which takes no ``sample_rate``."""
    chosen = {name: value for name, value in values.items() if value is not None}
    rate = chosen.pop("sample_rate", None)
    if rate is not None:
        check_option(
            "sample_time" not in chosen and rate > 0.0, "--sample-rate", "give either a positive rate or --sample-time"
        )
        chosen["sample_time"] = 1.0 / rate
    return chosen


def set_options(**values: Any) -> dict[str, str]:
    """The options that are set, as texts, the form in which a problem set takes them."""
    chosen = opening(**values)
    if "recording" not in chosen and {"input", "output"} <= chosen.keys():
        from bench.problems.recorded import TWO_FILES

        chosen |= {"recording": TWO_FILES, **{name: os.path.abspath(chosen[name]) for name in ("input", "output")}}
    return {name: str(value.resolve() if isinstance(value, Path) else value) for name, value in chosen.items()}


reads_a_recording = grouped("reading", RECORDING, opening)
"""A verb that receives the keywords of ``Recording.open``."""


def recording_of(recordings: Sequence[str | Path] | None, reading: Mapping[str, Any]) -> Path | None:
    """The first recording of a call; None for one in two files, which ``input`` and ``output`` name."""
    if not recordings and not {"input", "output"} <= reading.keys():
        raise typer.TyperException("Missing argument 'recording', or --input FILE and --output FILE")
    return Path(recordings[0]) if recordings else None


def files_of(recording: Path | None, reading: Mapping[str, Any]) -> list[Path]:
    """The file of a recording, or the two that ``input`` and ``output`` name."""
    from piezo_model.recordings.opening import split_name

    return [split_name(reading[name])[0] for name in ("input", "output")] if recording is None else [recording]
