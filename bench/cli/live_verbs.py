"""The verb that moves a stage: ``live`` runs a compensator on one, with a page in the browser."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.options import NoDynamics, check_option, check_writable
from bench.live.device import Declared, SimulatedStage, stage_of
from bench.live.session import run, stream_beside
from bench.live.settings import REFERENCES, Learn, LiveSettings, first_model
from bench.report.console import print_result
from piezo_model.units import quantity

SHARE = 0.6
"""Peak-to-peak height of the default sine of a simulated stage, as a share of the output's range."""
FASTEST_HZ = 10_000.0


def live_verb(
    model: Annotated[
        Path | None,
        typer.Argument(
            metavar="COMPENSATOR_OR_MODEL",
            help="Model from identify or compensator from deploy; by default it starts from a straight line.",
        ),
    ] = None,
    simulate: Annotated[
        str | None,
        typer.Option(
            metavar="KIND", help="Simulated actuator, such as relay_preisach, or flexure, a stage that rings."
        ),
    ] = None,
    device: Annotated[
        Path | None, typer.Option(metavar="STAGE.py", help="Python file with the class of your stage.")
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File with a reference column, repeated without end.")
    ] = None,
    sine_words: Annotated[
        str | None,
        typer.Option("--sine", metavar="5Hz:10um", help="Sine reference: frequency and amplitude, optionally :centre."),
    ] = None,
    set_point: Annotated[
        float | None, typer.Option(metavar="Y", help="Constant reference in the output's unit.")
    ] = None,
    rate: Annotated[float, typer.Option(metavar="HZ", min=1.0, max=FASTEST_HZ, help="Samples per second.")] = 1000.0,
    seconds: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, help="Duration in s; 0 until it is stopped.")
    ] = 0.0,
    learn: Annotated[Learn, typer.Option(help="Mode of learning.")] = "continuous",
    integral_gain: Annotated[
        float, typer.Option(metavar="GAIN", min=0.0, help="Gain of the integral action beside the compensation, 1/s.")
    ] = 0.0,
    no_dynamics: NoDynamics = False,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.parquet", help="File for the recording, which identify can read.")
    ] = None,
    page: Annotated[
        bool, typer.Option("--page/--no-page", help="Whether to serve a page that shows and steers the run.")
    ] = True,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address of the page; by default this machine only.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="PORT", min=1, max=65535, help="Port of the page.")] = 5006,
) -> None:
    """Run a compensator on a simulated stage or your own, and watch it learn.

    At the end, after an error too, the drive ramps to rest at the stage's rate limit.
    """
    check_option(
        (simulate is None) != (device is None),
        "--simulate KIND | --device STAGE.py",
        "give either a simulated actuator or the file of a stage",
    )
    references = {
        option: value
        for option, value in zip(REFERENCES, (reference, sine_words, set_point), strict=True)
        if value is not None
    }
    named = [*references][:2]
    check_option(len(references) < 2, "".join(named[1:]), f"give one reference, not {' and '.join(named)}")
    if record is not None:
        check_option(
            record.suffix == ".parquet",
            "--record",
            f"{record} is written as Parquet, so its name must end in .parquet",
        )
        check_writable(record, "--record", [reference, model])
        stream, move = stream_beside(record), f"move it away, or choose another name than {record.name}"
        check_option(not record.exists(), "--record", f"{record}: is a recording; {move}")
        check_option(not stream.exists(), "--record", f"{stream}: was left by an unfinished run; {move}")
    make = (
        partial(SimulatedStage, simulate, 1.0 / rate) if simulate is not None else partial(stage_of, Path(str(device)))
    )
    name = str(device) if simulate is None else f"simulated {simulate}"
    declared = Declared.of(make(), name)
    first = first_model(model, declared, 1.0 / rate, dynamics=not no_dynamics)
    low, high = sorted(declared.y_range)
    default = (
        {"--sine": f"1Hz:{0.5 * SHARE * (high - low):g}{declared.output_unit}"}
        if simulate
        else {"--set-point": 0.5 * (low + high)}
    )
    ((option, value),) = (references or default).items()
    samples, words = REFERENCES[option](value, declared.output_unit, declared.y_range, 1.0 / rate)
    settings = LiveSettings(
        make, name, declared, first, model is not None, learn, integral_gain, samples, words, rate, seconds
    )
    settings.compensator()  # or a sentence why there is none
    inverted = (
        f"The output lags the reference by {quantity(first.lag_s, 's', 3)}, since the dynamics of the stage are "
        "inverted."
    )
    print_result(None, False, inverted if first.lag_s else "", first.warning, settings.out_of_reach())
    sentences, status = run(settings, record, (host, port) if page else None)
    print_result(None, False, *sentences)
    raise typer.Exit(status)
