"""Verbs that export a model: ``export-c``, ``export-fmu``, and ``realtime``, which runs the exported C on this
machine."""

import json
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from bench.cli.options import AsJson, NoDynamics, Rate, RateLimit, XStart, check_writable, require
from bench.export.realtime import real_time
from bench.export.settings import EXACT_SOLVER, SOLVERS, Exported, ExportError, ExportSettings, LoopSolver, Precision
from bench.report.console import console, errors, plain_json, print_result
from bench.timing.percentiles import QUANTILES, Percentile, tail_cells
from piezo_model import HysteresisCreepModel
from piezo_model.atomic_file import write_text
from piezo_model.deployment import open_model
from piezo_model.learning.settings import Mode

ModelArgument = Annotated[Path, typer.Argument(help="Model from identify, or compensator from deploy.")]
PartChoice = Annotated[
    Exported | None,
    typer.Option(
        "--part",
        help="Compensation alone, or the complete self-learning loop; by default the loop of a file from deploy, and "
        "the compensation of a model.",
    ),
]
ModeChoice = Annotated[
    Mode | None,
    typer.Option("--mode", help="Mode of the self-learning loop: by default that of the file, for a model continuous."),
]
SolverChoice = Annotated[
    LoopSolver | None,
    typer.Option(
        "--solver",
        help="Solver of the self-learning loop: box_active_set finds the exact optimum; the others are for --mode "
        "cyclic.",
    ),
]
PrecisionChoice = Annotated[Precision, typer.Option("--precision", help="Number format of signals, states and model.")]
Low = Annotated[
    float | None,
    typer.Option("--low", help="Lowest drive; by default that of the compensator or the model's range."),
]
High = Annotated[
    float | None,
    typer.Option("--high", help="Highest drive; by default that of the compensator or the model's range."),
]
IntegralGain = Annotated[
    float,
    typer.Option(
        "--integral-gain", help="Gain of the integral action on the sensor in 1/s, its bandwidth in rad/s; 0 for none."
    ),
]


def export_c_verb(
    model: ModelArgument,
    folder: Annotated[Path, typer.Argument(help="New or empty folder for the source.")],
    precision: PrecisionChoice = "double",
    part: PartChoice = None,
    solver: SolverChoice = None,
    mode: ModeChoice = None,
    low: Low = None,
    high: High = None,
    rate_limit: RateLimit = None,
    x_start: XStart = None,
    rate: Rate = None,
    integral_gain: IntegralGain = 0.0,
    no_dynamics: NoDynamics = False,
    name: Annotated[str, typer.Option(help="Prefix of the names of files, functions and types.")] = "piezo",
) -> None:
    """Write the compensator as C99 for a controller."""
    from bench.export.building import write_folder
    from bench.export.c_source import export

    loaded, settings = _opened(
        model,
        low,
        high,
        rate,
        part,
        solver,
        mode,
        no_dynamics,
        precision=precision,
        name=name,
        rate_limit=rate_limit,
        x_start=x_start,
        integral_gain=integral_gain,
    )
    files = export(loaded, settings, f"Compensator of {model.name}")
    write_folder(folder, files)
    loop = f"the self-learning loop ({settings.mode}, {settings.solver})"
    what = loop if settings.learning else "the compensator, without learning"
    console.print(
        f"C99, {settings.precision}: {what} with d = {loaded.structure.d}; its README.md lists the files, "
        f"the calls and the memory.\nSource: {folder}; make -C {folder} run builds and runs the example."
    )


def export_fmu_verb(
    model: ModelArgument,
    out: Annotated[Path, typer.Argument(help="File of the FMU to write.")],
    fmi: Annotated[int, typer.Option(min=2, max=3, help="Major version of FMI.")] = 3,
    low: Low = None,
    high: High = None,
    rate_limit: RateLimit = None,
    x_start: XStart = None,
    rate: Rate = None,
    integral_gain: IntegralGain = 0.0,
    no_dynamics: NoDynamics = False,
) -> None:
    """Write the compensator as a Co-Simulation FMU, with a binary for this machine and the source."""
    from bench.export.fmu import write_fmu

    drive = {"rate_limit": rate_limit, "x_start": x_start, "integral_gain": integral_gain}
    loaded, settings = _opened(model, low, high, rate, "compensator", None, None, no_dynamics, **drive)
    require(out.suffix == ".fmu", "out", f"{out} does not end in .fmu")
    if out.exists():
        raise ExportError(f"{out} already exists; name a new file")
    check_writable(out, "out")
    write_fmu(loaded, settings, out, fmi)
    console.print(
        f"FMU: {out}, FMI {fmi}.0 Co-Simulation with a fixed step of {loaded.structure.sample_time:g} s.\n"
        "It compensates and does not learn; export-c writes the self-learning loop of a file from deploy."
    )


def realtime_verb(
    model: ModelArgument,
    rate: Annotated[float, typer.Option(min=1.0, max=1e6, help="Samples per second.")] = 8000.0,
    seconds: Annotated[float, typer.Option(min=0.01, help="Duration of the run in s.")] = 60.0,
    part: PartChoice = None,
    solver: SolverChoice = None,
    mode: ModeChoice = None,
    precision: PrecisionChoice = "double",
    priority: Annotated[
        int, typer.Option(min=0, max=99, help="Priority under SCHED_FIFO; 0 for the default scheduler.")
    ] = 80,
    core: Annotated[int | None, typer.Option(min=0, help="Core to run on; the last free one by default.")] = None,
    no_dynamics: NoDynamics = False,
    out: Annotated[Path | None, typer.Option(help="JSON file to write histograms and figures to.")] = None,
    as_json: AsJson = False,
) -> None:
    """Run the exported C on this machine with absolute deadlines and count those it misses."""
    check_writable(out, others=[model])
    loaded, settings = _opened(model, None, None, None, part, solver, mode, no_dynamics, precision=precision)
    result = real_time(loaded, settings, rate, seconds, priority, core)
    if out is not None:
        write_text(out, json.dumps(plain_json(result.to_dict()), indent=1) + "\n")
    step, counts = result.step, result.histograms
    bounds = sorted({bound for count in counts.values() for bound in count})
    times = [(name, *tail_cells(us, digits=2)) for name, us in result.times_us.items()]
    octaves = [(f"{bound:g}", *(str(count.get(bound, 0)) for count in counts.values())) for bound in bounds]
    asked = {"memory": "locking memory", "core": "pinning to a core", "fifo": "SCHED_FIFO"}
    lines = [
        f"{step.missed} of {step.response_ns.size} deadlines at {step.rate_Hz:g} Hz missed; of a step that "
        f"does nothing, {result.null.missed}.",
        f"New weights came late {step.allowed['late']} times, and {step.allowed['dropped']} blocks of samples were "
        "left out."
        if settings.learning
        else "",
        *(
            f"Without {asked[what]}: {step.allowed.get(what, 'not asked for')}."
            for what in asked
            if step.allowed.get(what) != "yes"
        ),
        f"Figures: {out}" if out else "",
    ]
    print_result(
        result.to_dict(),
        lines,
        as_json,
        (("µs", *(Percentile(q).name for q in QUANTILES), "max"), times, 1),
        (("up to, µs", *counts), octaves, 1),
    )


def _opened(
    path: Path,
    low: float | None,
    high: float | None,
    rate: float | None,
    part: Exported | None,
    solver: LoopSolver | None,
    mode: Mode | None,
    no_dynamics: bool = False,
    **options: Any,
) -> tuple[HysteresisCreepModel, ExportSettings]:
    """Model and export settings from a file of identify, by default of the compensator alone, or of deploy, by default
    of what was deployed; learning is continuous by default."""
    model, deployed = open_model(path)
    model = model.static if no_dynamics else model
    part = part or ("learning" if deployed else "compensator")
    require(
        part == "learning" or not (solver or mode),
        "--solver" if solver else "--mode",
        "is for --part learning; a compensator alone does not learn",
    )
    mode = mode or (deployed.mode if deployed else "continuous")
    if solver is None:
        solver = EXACT_SOLVER if mode == "continuous" else cast(LoopSolver, deployed.solver) if deployed else SOLVERS[0]
    if model.warning:
        errors.print(model.warning, soft_wrap=True)
    model = model if rate is None else model.at(1.0 / rate)
    lowest, highest = deployed.x_limits if deployed else model.structure.x_range
    limits = (lowest if low is None else low, highest if high is None else high)
    return model, ExportSettings(part=part, solver=solver, mode=mode, x_limits=limits, **options)
