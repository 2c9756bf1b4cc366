"""Verbs for models: ``identify`` one from a recording, ``validate`` it on another, ``simulate`` a drive with it,
``compensate`` a reference with it."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bench.cli.fleet import OutDir, only, process
from bench.cli.options import (
    FILE,
    READING,
    STARTS,
    AsJson,
    RateLimit,
    SolverName,
    Start,
    StartOfModel,
    XStart,
    check_option,
    check_writable,
    files_of,
    grouped,
    on_workers,
    opening,
    reads_a_recording,
    recording_of,
    refuse,
)
from bench.deploy.deployment import open_model
from bench.fleet import jobs
from bench.fleet.fleet import local
from bench.processes.engine import Workers
from bench.report import recording_page
from bench.report.console import console, print_result, progress_bar
from bench.report.fit_review import review
from piezo_model import Recording, checks, recordings
from piezo_model.identification.dynamics import DynamicsChoice, LagChoice
from piezo_model.identification.identify import Estimator
from piezo_model.model import ModelError
from piezo_model.units import percent, quantity

MOST = 200
"""Largest order: more operators take minutes, and describe no stage better."""
SHOWN = 8
"""Rows of the table of candidates; the page has all."""


def _rates(text: str) -> tuple[float, ...]:
    """Parser of an option: creep rates, separated by commas."""
    if text.strip().lower() in ("", "none"):
        return ()
    try:
        rates = tuple(map(float, text.split(",")))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of numbers separated by commas") from None
    if not all(0.0 < rate < float("inf") for rate in rates):
        raise typer.BadParameter(f"{text!r} has a rate that is not positive and finite")
    return rates


@on_workers
@reads_a_recording
def identify_verb(
    context: typer.Context,
    reading: dict[str, Any],
    workers: Workers,
    recording: Annotated[
        list[str] | None, typer.Argument(help=f"{FILE} Several are of one stage; or of many, with --out-dir.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.json", help="JSON file for the model.")] = None,
    out_dir: OutDir = None,
    n: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=0, max=MOST, help="Order of hysteresis and creep; by an information criterion by default."
        ),
    ] = None,
    m: Annotated[
        int | None,
        typer.Option(metavar="M", min=0, max=MOST, help="Order of the superposition on each side; likewise."),
    ] = None,
    creep_rates: Annotated[
        Any,
        typer.Option(
            "--rates",
            "--creep-rates",
            metavar="RATES",
            parser=_rates,
            help="Creep rates in 1/s, separated by commas, or 'none'; by default as the data determine.",
        ),
    ] = None,
    skip: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, help="Samples at the start to leave out; those of a transient by default."),
    ] = None,
    lag: Annotated[
        LagChoice,
        typer.Option(help="Whether to estimate a lag, remove it as that of the sensor, or ignore it."),
    ] = "estimate",
    dynamics: Annotated[
        DynamicsChoice,
        typer.Option(help="Whether to estimate a resonance and its delay if the data determine them, or ignore them."),
    ] = "estimate",
    estimator: Annotated[
        Estimator, typer.Option(help="Whether to minimise the output error, or only the paper's error model.")
    ] = "forward",
    solver: SolverName = "box_active_set",
    force: Annotated[
        bool, typer.Option("--force", help="Write the model even if it does not describe the data.")
    ] = False,
    page: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="HTML file for a page with plots and findings.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Identify a model of hysteresis and creep from a recording, or from several of one stage, such as a slow and a
    fast one; or with --out-dir a model from each of many.

    It reports how well the model fits and what the recordings lack; --page draws the fit of one recording.
    """
    file = recording_of(recording, reading)
    options = {"n": n, "m": m, "creep_rates": creep_rates, "skip": skip, "lag": lag, "dynamics": dynamics}
    job = jobs.Identifying(reading, options | {"estimator": estimator, "solver": solver, "force": force})
    if out is None:
        process(job, recording or (), out_dir, workers, "gave a model", as_json, page)
        return
    only(context, (), out_dir)
    sources: list[Path | None] = [*map(Path, recording or ())] or [file]
    check_option(page is None or len(sources) == 1, "--page", "is for one recording; draw each with validate --page")
    files = [path for source in sources for path in files_of(source, reading)]
    check_writable(out, others=files)
    check_writable(page, "--page", [*files, out])
    several = [Recording.open(source, **job.opening) for source in sources]
    if not as_json:
        console.print("\n".join(each.describe() for each in several))
    with progress_bar() as progress:
        model = job.of(several, progress)
    model.save(out)
    if page is not None:
        with progress_bar("writing the page"):
            recording_page.write(page, Path(several[0].name).name, review(several[0], model))
    selection = model.report.get("selection")
    tried = recording_page.orders_tried(selection) if selection else None
    lines = [
        selection["sentence"] if selection else "",
        model.report["headline"],
        model.report["data_sheet"],
        model.report["drive"]["sentence"],
        *model.report["findings"],
        f"Model: {out}",
        f"Page: {page}" if page else "",
    ]
    print_result(
        {"model": out, "page": page, "report": dict(model.report)},
        as_json,
        (tried.headings, tried.rows[:SHOWN], tried.left_aligned) if tried else "",
        *lines,
    )


@on_workers
@reads_a_recording
def validate_verb(
    context: typer.Context,
    model: Annotated[
        str, typer.Argument(help="Model from identify; for many recordings also the folder of their models.")
    ],
    reading: dict[str, Any],
    workers: Workers,
    recording: Annotated[
        list[str] | None,
        typer.Argument(help="A recording in any known format; or many, with --out-dir."),
    ] = None,
    out_dir: OutDir = None,
    page: Annotated[Path | None, typer.Option(metavar="FILE.html", help="HTML file for a page with plots.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check a model against another recording than that of its identification, or against many.

    The initial states are estimated as in identify; a constant shift of the output between the two recordings is
    removed and reported. A sentence says if the model was fitted to this recording.
    """
    file = recording_of(recording, reading)
    job = jobs.Validating(str(local(model)), reading)
    if out_dir is not None or len(recording or ()) > 1:
        process(job, recording or (), out_dir, workers, "were judged", as_json, page)
        return
    only(context, recording or (), out_dir)
    check_writable(page, "--page", [*files_of(file, reading), model])
    opened, loaded, result = job.judged(file, Path(model))
    if page is not None:
        recording_page.write(page, Path(opened.name).name, review(opened, loaded, result))
    lines = [opened.describe(), *result.sentences(), f"Page: {page}" if page else ""]
    print_result({"model": model, "page": page, **result.to_dict()}, as_json, *lines)


@grouped(
    "reading",
    {
        "time": READING["time"],
        "column": Annotated[
            str | None, typer.Option("--input", metavar="COLUMN", help="Input column, such as voltage_V.")
        ],
        **READING,
    },
    opening,
)
def simulate_verb(
    model: Annotated[Path, typer.Argument(help="Model from identify.")],
    drive: Annotated[Path, typer.Argument(help="File with a drive column, in any format of recordings.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="CSV or Parquet file for drive and output.")],
    reading: dict[str, Any],
    start: StartOfModel = None,
    as_json: AsJson = False,
) -> None:
    """Compute the output of the model for a drive."""
    check_writable(out, others=[drive, model])
    loaded, _ = open_model(model)
    read = recordings.read_reference(drive, role="input", **reading)
    signal = read.suited(loaded.structure.input_unit, "input")
    with checks.refusing(ModelError, f"{model} with {drive}: "):
        loaded = loaded.at(read.sample_time)
    s = loaded.structure
    state, began = loaded.initial_state(start), start or ("rest" if loaded.start is None else "recording")
    y = loaded.simulate(signal.values, state)
    names = (f"{name}_{unit}" if unit else name for name, unit in (("drive", s.input_unit), ("output", s.output_unit)))
    columns = {"time_s": np.arange(y.size) * signal.sample_time, **dict(zip(names, (signal.values, y), strict=True))}
    recordings.write_table(out, columns, loaded.warning)
    lowest, highest = y.min(), y.max()
    lines = [
        read.describe("input"),
        loaded.warning,
        signal.units,
        STARTS[began].format(quantity(s.x_centre + s.x_scale * state.play[0], s.input_unit)),
        f"{y.size} samples of output from {quantity(lowest, s.output_unit)} to {quantity(highest, s.output_unit)}.",
        f"Output: {out}",
    ]
    print_result(
        {
            "output": out,
            "samples": y.size,
            "lowest": lowest,
            "highest": highest,
            "unit": s.output_unit,
            "start": began,
            "units": signal.units,
            "forced": loaded.warning,
        },
        as_json,
        *lines,
    )


@on_workers
@grouped(
    "reading",
    {
        "time": READING["time"],
        "column": Annotated[str | None, typer.Option("--reference", metavar="COLUMN", help="Reference column.")],
        **READING,
    },
    opening,
)
def compensate_verb(
    context: typer.Context,
    model: Annotated[
        str, typer.Argument(help="Model from identify; for many references also the folder of their models.")
    ],
    reference: Annotated[
        list[str],
        typer.Argument(help="File with a reference column, in any format of recordings; or many, with --out-dir."),
    ],
    reading: dict[str, Any],
    workers: Workers,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="CSV or Parquet file for the drive of one reference.")
    ] = None,
    out_dir: OutDir = None,
    low: Annotated[
        float | None, typer.Option(metavar="X", help="Lowest drive; by default that of the model's range.")
    ] = None,
    high: Annotated[
        float | None, typer.Option(metavar="X", help="Highest drive; by default that of the model's range.")
    ] = None,
    rate_limit: RateLimit = None,
    start: Start = "rest",
    x_start: XStart = None,
    dynamics: Annotated[
        bool,
        typer.Option("--dynamics/--no-dynamics", help="Whether to invert the model's dynamics, which costs a lag."),
    ] = True,
    preview: Annotated[
        bool, typer.Option("--preview", help="Invert the dynamics without lag: the drive anticipates the reference.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Compute the drive that makes the actuator follow a reference, or one for each of many."""
    if start == "recording":
        refuse(context, ("x_start",), "is for --start rest; the states of the recording say where the drive starts")
    check_option(dynamics or not preview, "--preview", "inverts the dynamics, which --no-dynamics leaves out")
    job = jobs.Compensating(str(local(model)), reading, low, high, rate_limit, start, x_start, dynamics, preview)
    if out is None:
        process(job, reference, out_dir, workers, "gave a drive", as_json)
        return
    only(context, reference, out_dir)
    file = Path(reference[0])
    check_writable(out, others=[file, model])
    result = job.do(file, [Path(model)], out)
    follows = f"within {100.0 * jobs.FOLLOWED:g} % of the output's range"
    misses = f"{quantity(result['largest_error'], result['output_unit'], 3)} at {result['largest_error_s']:.4g} s"
    lowest, highest = (quantity(result[end], result["unit"]) for end in ("lowest", "highest"))
    lines = [
        result["reading"],
        f"The model follows {100.0 * result['share_followed']:.3g} % of the reference {follows}; the largest error is "
        f"{misses}."
        if result["share_followed"] < 1.0
        else f"The model follows all of the reference {follows}.",
        f"The output lags the reference by {quantity(result['lag_s'], 's', 3)}, after which these errors are computed."
        if result["lag_s"]
        else "",
        STARTS[result["start"]].format(quantity(result["x_start"], result["unit"])),
        result["units"],
        result["forced"],
        f"{result['samples']} samples of drive from {lowest} to {highest}; "
        + (
            f"{percent(100.0 * result['share_at_limits'])} of them at the limits, where the reference cannot be "
            "followed."
            if result["share_at_limits"]
            else "the limits are never reached."
        ),
        f"Drive: {out}",
    ]
    print_result({"drive": out, **result}, as_json, *lines)
