"""The options of every verb that reads a recording: what the file itself does not say, defined once."""

import functools
from typing import Annotated, Any, Literal, TypedDict

import typer

from bench.cli.option_groups import Verb, grouped

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


class ReadOptions(TypedDict):
    """Keywords of ``Recording.open`` and ``read_reference``."""

    sample_time: float | None
    header_row: int | None
    decimal: str | None
    sheet: str | None
    resample: float | None
    input_unit: str | None
    output_unit: str | None


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
