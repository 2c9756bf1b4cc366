"""The verb ``live``: a compensator on a stage, watched in a browser."""

from pathlib import Path
from typing import Annotated

import typer

from bench.live.device import Declared, DeviceFile, Simulated
from bench.live.recorder import check
from bench.live.reference import ReferenceError, constant, of_file, sine, staircase
from bench.live.session import run
from bench.live.task import Learn, Task, first_model
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

    if not integral_gain <= rate:
        raise typer.BadParameter(
            f"must be at most the rate, {rate:g} 1/s, not {integral_gain:g}", param_hint="--integral-gain"
        )
    stage = Simulated(simulate, 1.0 / rate, seed) if simulate is not None else DeviceFile(Path(str(device)))
    declared = Declared.of(stage.make(), str(stage))
    first = first_model(model, declared, 1.0 / rate)
    if record is not None:
        check(record)
    if page:
        from bench.live.page import check_address  # which needs Bokeh

        check_address(host, port)
    (low, high), sample_time, unit = declared.y_range, 1.0 / rate, declared.output_unit
    centre = 0.5 * (low + high)
    if reference is not None:
        wanted = of_file(reference, unit, sample_time)
    elif sine_words is not None:
        wanted = sine(sine_words, unit, centre, sample_time)
    elif staircase_words is not None:
        wanted = staircase(staircase_words, unit, centre, sample_time)
    elif set_point is not None and not low <= set_point <= high:
        raise ReferenceError(f"--set-point {set_point:g} is outside of the stage's range, {low:g} to {high:g} {unit}")
    elif simulate is not None and set_point is None:
        wanted = sine(f"1Hz:{0.5 * SHARE * (high - low)!r}", unit, centre, sample_time)
    else:
        wanted = constant(centre if set_point is None else set_point)
    task = Task(stage, declared, first, model is not None, learn, integral_gain, wanted, rate, seconds)
    found = run(task, record, (host, port) if page else None, _told)
    for sentence in found.sentences:
        console.print(sentence)
    if found.status:
        raise typer.Exit(found.status)


def _told(text: str) -> None:
    """Print at once, even where standard output is not a terminal: the address of the page is needed while it runs."""
    console.print(text)
    console.file.flush()
