"""Verbs that export a model: ``export-c``, ``export-fmu``, and ``realtime``, which runs the exported C on this
machine."""

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from bench.cli.options import AsJson, NoDynamics, RateLimit, XStart, check_option, check_writable, grouped, positive
from bench.deploy.deployment import open_model
from bench.export import building, c_source, fmu, realtime
from bench.export.settings import EXACT_SOLVER, SOLVERS, Exported, ExportSettings, LoopSolver, Precision
from bench.report.console import console, errors, print_result
from bench.timing import percentiles
from piezo_model import HysteresisCreepModel
from piezo_model.learning.settings import Mode

ModelArgument = Annotated[Path, typer.Argument(help="Model from identify, or compensator from deploy.")]
CONTROL: dict[str, Any] = {
    "low": Annotated[
        float | None,
        typer.Option(metavar="X", help="Lowest drive; by default that of the compensator or the model's range."),
    ],
    "high": Annotated[
        float | None,
        typer.Option(metavar="X", help="Highest drive; by default that of the compensator or the model's range."),
    ],
    "rate_limit": RateLimit,
    "x_start": XStart,
    "rate": Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            callback=positive,
            min=1e-9,
            max=1e9,
            help="Samples per second of the controller; the model's by default.",
        ),
    ],
    "integral_gain": Annotated[
        float | None,
        typer.Option(
            metavar="GAIN",
            help="Gain of the integral action on the sensor in 1/s, its bandwidth in rad/s; none by default.",
        ),
    ],
}
LOOP: dict[str, Any] = {
    "precision": Annotated[
        Precision | None, typer.Option(help="Number format of signals, states and model; double by default.")
    ],
    "part": Annotated[
        Exported | None,
        typer.Option(
            help="Compensation alone, or the complete self-learning loop; by default the loop of a file from deploy, "
            "and the compensation of a model."
        ),
    ],
    "solver": Annotated[
        LoopSolver | None,
        typer.Option(
            help="Solver of the self-learning loop: box_active_set finds the exact optimum; the others are for --mode "
            "cyclic."
        ),
    ],
    "mode": Annotated[
        Mode | None,
        typer.Option(help="Mode of the self-learning loop: by default that of the file, for a model continuous."),
    ],
}


@grouped("control", CONTROL)
@grouped("loop", LOOP)
def export_c_verb(
    model: ModelArgument,
    folder: Annotated[Path, typer.Argument(help="New or empty folder for the source.")],
    control: dict[str, Any],
    loop: dict[str, Any],
    no_dynamics: NoDynamics = False,
    name: Annotated[
        str, typer.Option(metavar="PREFIX", help="Prefix of the names of files, functions and types.")
    ] = "piezo",
) -> None:
    """Write the compensator as C99 for a controller."""

    loaded, settings = _opened(model, no_dynamics, name=name, **control, **loop)
    building.write_folder(folder, c_source.export(loaded, settings, f"Compensator of {model.name}"))
    what = (
        f"the self-learning loop ({settings.mode}, {settings.solver})"
        if settings.learning
        else "the compensator, without learning"
    )
    console.print(
        f"C99, {settings.precision}: {what} with d = {loaded.structure.d}; its README.md lists the files, "
        f"the calls and the memory.\nSource: {folder}; make -C {folder} run builds and runs the example."
    )


@grouped("control", CONTROL)
def export_fmu_verb(
    model: ModelArgument,
    out: Annotated[Path, typer.Argument(help="File of the FMU to write.")],
    control: dict[str, Any],
    fmi: Annotated[int, typer.Option(metavar="2|3", min=2, max=3, help="Major version of FMI.")] = 3,
    no_dynamics: NoDynamics = False,
) -> None:
    """Write the compensator as a Co-Simulation FMU, with a binary for this machine and the source."""

    loaded, settings = _opened(model, no_dynamics, part="compensator", **control)
    check_option(out.suffix == ".fmu", "out", f"{out} does not end in .fmu")
    check_option(not out.exists(), "out", f"{out} already exists; name a new file")
    check_writable(out, "out")
    fmu.write_fmu(loaded, settings, out, fmi)
    console.print(
        f"FMU: {out}, FMI {fmi}.0 Co-Simulation with a fixed step of {loaded.structure.sample_time:g} s.\n"
        "It compensates and does not learn; export-c writes the self-learning loop of a file from deploy."
    )


@grouped("loop", LOOP)
def realtime_verb(
    model: ModelArgument,
    loop: dict[str, Any],
    rate: Annotated[float, typer.Option(metavar="HZ", min=1.0, max=1e6, help="Samples per second.")] = 8000.0,
    seconds: Annotated[float, typer.Option(metavar="SECONDS", min=0.01, help="Duration of the run in s.")] = 60.0,
    priority: Annotated[
        int, typer.Option(metavar="N", min=0, max=99, help="Priority under SCHED_FIFO; 0 for the default scheduler.")
    ] = 80,
    core: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Core to run on; the last free one by default.")
    ] = None,
    no_dynamics: NoDynamics = False,
    as_json: AsJson = False,
) -> None:
    """Run the exported C on this machine with absolute deadlines and count those it misses."""
    loaded, settings = _opened(model, no_dynamics, rate=rate, **loop)
    result = realtime.real_time(loaded, settings, rate, seconds, priority, core)
    allowed, counts = result.allowed, result.histograms
    bounds = sorted({bound for count in counts.values() for bound in count})
    times = [(name, *percentiles.tail_cells(us, digits=2)) for name, us in result.times_us.items()]
    octaves = [(f"{bound:g}", *(str(count.get(bound, 0)) for count in counts.values())) for bound in bounds]
    guarantees = {"memory": "locking memory", "core": "pinning to a core", "fifo": "SCHED_FIFO"}
    lines = [
        f"{result.missed('response')} of {result.times_us['response'].size} deadlines at {result.rate_Hz:g} Hz missed, "
        f"and {result.missed('null response')} by a step that does nothing.",
        f"New weights came late {allowed['late']} times, and {allowed['dropped']} blocks of samples were dropped."
        if settings.learning
        else "",
        *(
            f"Without {guarantees[what]}: {allowed.get(what, 'not asked for')}."
            for what in guarantees
            if allowed.get(what) != "yes"
        ),
    ]
    print_result(
        result.to_dict(),
        as_json,
        (("µs", *map(percentiles.name, percentiles.QUANTILES), "max"), times, 1),
        (("up to, µs", *counts), octaves, 1),
        *lines,
    )


def _opened(
    path: Path,
    no_dynamics: bool = False,
    part: Exported | None = None,
    solver: LoopSolver | None = None,
    mode: Mode | None = None,
    low: float | None = None,
    high: float | None = None,
    rate: float | None = None,
    **options: Any,
) -> tuple[HysteresisCreepModel, ExportSettings]:
    """Model and export settings from a file of identify, by default of the compensator alone, or of deploy, by default
    of what was deployed; learning is continuous by default."""
    model, deployed = open_model(path)
    model = model.static if no_dynamics else model
    part = part or ("learning" if deployed else "compensator")
    check_option(
        part == "learning" or not (solver or mode),
        "--solver" if solver else "--mode",
        "is for --part learning; a compensator alone does not learn",
    )
    mode = mode or (deployed.mode if deployed else "continuous")
    if solver is None:
        solver = EXACT_SOLVER if mode == "continuous" else cast(LoopSolver, deployed.solver) if deployed else SOLVERS[0]
    model = model if rate is None else model.at(1.0 / rate)
    if model.warning:
        errors.print(model.warning, soft_wrap=True)
    lowest, highest = deployed.x_limits if deployed else model.structure.x_range
    limits = (lowest if low is None else low, highest if high is None else high)
    chosen = {name: value for name, value in options.items() if value is not None}
    return model, ExportSettings(part=part, solver=solver, mode=mode, x_limits=limits, **chosen)
