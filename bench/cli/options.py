"""Options that several verbs share, defined once, and the refusal of those that a call would not use."""

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, Literal

import typer

from solvers import find

Verb = Callable[..., None]


def grouped(group: str, options: Mapping[str, Any]) -> Callable[[Verb], Verb]:
    """Add options, as annotations by their names, to a verb, which gets their values by name as its argument
    ``group``."""

    def decorate(verb: Verb) -> Verb:
        signature = inspect.signature(verb, eval_str=True)
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in options.items()
        ]
        parameters = [*(parameter for name, parameter in signature.parameters.items() if name != group), *added]

        @functools.wraps(verb)
        def wrapped(**given: Any) -> None:
            values = {name: given.pop(name) for name in options}
            verb(**given, **{group: values})

        wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate


def is_given(context: typer.Context, option: str) -> bool:
    """Whether the command line names this parameter of the verb, if only with its default."""
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"


def refuse(context: typer.Context, options: Iterable[str], why: str) -> None:
    """Refuse these parameters of the verb where the command line names one; ``why`` follows its name."""
    for option in options:
        if is_given(context, option):
            raise typer.BadParameter(
                why, param_hint=next(each.opts[0] for each in context.command.params if each.name == option)
            )


def installed(name: str) -> str:
    """The name of a solver that is known and installed here; any other is refused."""
    try:
        find(name).load()
    except KeyError as error:
        raise typer.BadParameter(str(error.args[0])) from None
    except ImportError as error:
        raise typer.BadParameter(f"{name} is not installed here ({error})") from None
    return name


SolverName = Annotated[str, typer.Option("--solver", callback=installed, help="Any registered solver.")]


FILE = "A recording in any known format; piezobench inspect shows how it is read."
Time = Annotated[
    str | None,
    typer.Option(
        help="Time column: a name, a path such as group/channel, or a number counted "
        "from 1; guessed by default; none for no clock."
    ),
]
Input = Annotated[str | None, typer.Option(help="Input column, such as voltage_V.")]
Output = Annotated[str | None, typer.Option(help="Output column, such as displacement_um.")]
READING_OPTIONS: dict[str, Any] = {
    "sample_time": Annotated[float | None, typer.Option(help="Sampling period in s, for a file without times.")],
    "sample_rate": Annotated[float | None, typer.Option(help="Sampling rate in Hz, in place of --sample-time.")],
    "header_row": Annotated[int | None, typer.Option(help="Row that names the columns, counted from 1; 0 for none.")],
    "decimal": Annotated[str | None, typer.Option(help="Decimal mark of a text, '.' or ','; found by default.")],
    "sheet": Annotated[str | None, typer.Option(help="Sheet of a workbook; the largest table by default.")],
    "resample": Annotated[
        float | None, typer.Option(help="Sampling period in s to interpolate to, for times that are not even.")
    ],
    "input_unit": Annotated[
        str | None, typer.Option(help="Unit of the input, such as V, where the file does not say it.")
    ],
    "output_unit": Annotated[
        str | None, typer.Option(help="Unit of the output, such as um, where the file does not say it.")
    ],
}


Start = Annotated[
    Literal["identified", "rest"],
    typer.Option(
        "--start",
        help="Begin with the states that identify found before its recording, or at rest at the centre of the range.",
    ),
]
STARTS = {
    "identified": "Begins with the states that identify found before its recording.",
    "rest": "Begins at rest at the centre of the range.",
}


def as_text(**said: Any) -> dict[str, str]:
    """What was said of a recording, as the options of a problem set."""
    return {name: str(value) for name, value in said.items() if value is not None}


def reads_a_recording(verb: Verb) -> Verb:
    """Add the options to a verb, which gets them together as its argument ``reading``."""

    @grouped("reading", READING_OPTIONS)
    @functools.wraps(verb)
    def wrapped(*, reading: dict[str, Any], **given: Any) -> None:
        rate = reading.pop("sample_rate")
        if rate is not None:
            if reading["sample_time"] is not None or not rate > 0.0:
                raise typer.BadParameter("say either a positive rate or --sample-time", param_hint="--sample-rate")
            reading["sample_time"] = 1.0 / rate
        verb(reading=reading, **given)

    return wrapped
