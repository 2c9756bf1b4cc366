"""The verb ``live``: a compensator on a stage, watched in a browser."""

from pathlib import Path
from typing import Annotated

import typer

from bench.live.controller import Learn, Plan
from bench.live.device import Declared, DeviceFile, Simulated
from bench.live.reference import Reference, ReferenceError, constant, of_file, sine, staircase
from bench.live.session import Session
from bench.report.console import check_writable, console

SHARE = 0.6
"""Of the output's range, the default sine of a simulated stage."""
FASTEST_HZ = 20_000.0


def live_verb(
    model: Annotated[
        Path | None,
        typer.Argument(
            metavar="[COMPENSATOR_OR_MODEL]",
            help="A model written by identify, or what deploy wrote; learned from the straight line on by default.",
        ),
    ] = None,
    simulate: Annotated[
        str | None, typer.Option(metavar="KIND", help="A simulated actuator, such as relay_preisach.")
    ] = None,
    device: Annotated[Path | None, typer.Option(metavar="STAGE.py", help="A file with the class of a stage.")] = None,
    reference: Annotated[
        Path | None, typer.Option(help="A file with a reference column, followed over and over.")
    ] = None,
    sine_words: Annotated[
        str | None, typer.Option("--sine", metavar="5Hz:10um", help="Frequency and amplitude, and a centre if need be.")
    ] = None,
    staircase_words: Annotated[
        str | None, typer.Option("--staircase", metavar="0.5s:4um:8", help="Time and height of a level, and how many.")
    ] = None,
    set_point: Annotated[float | None, typer.Option(help="One value, output unit.")] = None,
    rate: Annotated[float, typer.Option(help=f"Samples a second, up to {FASTEST_HZ:g}.")] = 1000.0,
    seconds: Annotated[float, typer.Option(min=0.0, help="How long; 0 until it is stopped.")] = 0.0,
    learn: Annotated[Learn, typer.Option(help="How it learns.")] = "continuous",
    integral_gain: Annotated[
        float, typer.Option(min=0.0, help="Of integral action beside the compensation, 1/s.")
    ] = 0.0,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.parquet", help="Where everything is recorded; identify reads it.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of a simulated sensor's noise.")] = 0,
    page: Annotated[
        bool, typer.Option("--page/--no-page", help="Whether there is a page to watch and steer it.")
    ] = True,
    host: Annotated[str, typer.Option(help="Address of the page; of this machine only by default.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page.")] = 5006,
) -> None:
    """Run a compensator on a stage, simulated or your own, and watch it learn.

    However it ends, the drive ramps to rest at the stage's rate limit.
    """
    if (simulate is None) == (device is None):
        raise typer.BadParameter(
            "say either a simulated actuator or a stage's file", param_hint="--simulate KIND | --device STAGE.py"
        )
    if not 1.0 <= rate <= FASTEST_HZ:
        raise typer.BadParameter(f"the rate must be from 1 to {FASTEST_HZ:g} Hz, not {rate:g}", param_hint="--rate")
    shapes = {"--reference": reference, "--sine": sine_words, "--staircase": staircase_words, "--set-point": set_point}
    if len(given := [name for name, value in shapes.items() if value is not None]) > 1:
        raise typer.BadParameter(
            f"{given[0]} and {given[1]} are two references, and one can be followed", param_hint=given[1]
        )
    if record is not None:
        if record.suffix != ".parquet":
            raise typer.BadParameter(
                f"{record} is written as Parquet, so its name must end in .parquet", param_hint="--record"
            )
        check_writable(record, "--record")

    def wanted(stage: Declared) -> Reference:
        (low, high), sample_time, unit = stage.y_range, 1.0 / rate, stage.output_unit
        centre = 0.5 * (low + high)
        if reference is not None:
            return of_file(reference, unit, sample_time)
        if sine_words is not None:
            return sine(sine_words, unit, centre, sample_time)
        if staircase_words is not None:
            return staircase(staircase_words, unit, centre, sample_time)
        if set_point is not None and not low <= set_point <= high:
            raise ReferenceError(
                f"--set-point {set_point:g} is outside of the stage's range, {low:g} to {high:g} {unit}"
            )
        if simulate is not None and set_point is None:
            return sine(f"1Hz:{0.5 * SHARE * (high - low)!r}", unit, centre, sample_time)
        return constant(centre if set_point is None else set_point)

    where = Simulated(simulate, 1.0 / rate, seed) if simulate is not None else DeviceFile(device)  # type: ignore[arg-type]
    session = Session(
        where, Plan(model, learn, integral_gain), wanted, rate, seconds, record, (host, port) if page else None
    )
    found = session.run(_told)
    for sentence in found.sentences:
        console.print(sentence)
    if found.status:
        raise typer.Exit(found.status)


def _told(text: str) -> None:
    """Print at once, even where standard output is not a terminal: the address of the page is needed while it runs."""
    console.print(text)
    console.file.flush()
