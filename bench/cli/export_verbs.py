"""Verbs that take a model out of Python: ``export-c``, ``export-fmu``, and ``realtime``, the exported C on this machine."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from bench.cli.console import console, errors, print_table
from bench.export.settings import ExportError, ExportSettings
from bench.percentiles import QUANTILES, percentile
from piezo_model import HysteresisCreepModel, ModelError
from piezo_model.deployment import FORMAT, Deployment

SOLVERS = ("projected_difference", "recursive_active_set")


class PrecisionOption(StrEnum):
    """Numbers of the exported C."""

    double = "double"
    float = "float"


class PartOption(StrEnum):
    """What is exported."""

    compensator = "compensator"
    learning = "learning"


class SolverOption(StrEnum):
    """What learns in the exported C."""

    projected_difference = "projected_difference"
    recursive_active_set = "recursive_active_set"


ModelArgument = Annotated[Path, typer.Argument(help="Model written by identify, or compensator written by deploy.")]
PartChoice = Annotated[PartOption, typer.Option("--part", help="Compensation alone, or the whole self-learning loop.")]
SolverChoice = Annotated[SolverOption | None, typer.Option("--solver", help="Of the learning: one projected step a sample in "
                                                           "cycles, or the exact optimum after every sample.")]
PrecisionChoice = Annotated[PrecisionOption, typer.Option("--precision", help="Of signals, states and model.")]
Low = Annotated[float | None, typer.Option("--low", help="Lowest drive; the file's or the model's range by default.")]
High = Annotated[float | None, typer.Option("--high", help="Highest drive; the file's or the model's range by default.")]
RateLimit = Annotated[float | None, typer.Option("--rate-limit", help="Fastest change of the drive, per second.")]


def register(app: typer.Typer) -> None:
    """Add the verbs."""
    app.command("export-c")(export_c_verb)
    app.command("export-fmu")(export_fmu_verb)
    app.command("realtime")(realtime_verb)


def export_c_verb(
    model: ModelArgument,
    folder: Annotated[Path, typer.Argument(help="New or empty folder for the source.")],
    precision: PrecisionChoice = PrecisionOption.double,
    part: PartChoice = PartOption.compensator,
    solver: SolverChoice = None,
    low: Low = None,
    high: High = None,
    rate_limit: RateLimit = None,
    name: Annotated[str, typer.Option(help="Prefix of files, functions and types.")] = "piezo",
) -> None:
    """Write the compensator as C99 for a controller."""
    from bench.export.c_source import render
    from bench.export.folder import write_folder

    loaded, settings = _opened(model, low, high, rate_limit, solver, precision=precision.value, part=part.value, name=name)
    files = render(loaded, settings, f"Compensator of {model.name}")
    write_folder(folder, files)
    what = {"compensator": "the compensator", "learning": f"the self-learning loop with {settings.solver}"}[settings.part]
    console.print(f"C99, {settings.precision}: {what} with d = {loaded.structure.d}; README.md says memory and operations.")
    console.print(f"Source: {folder}; make -C {folder} run builds and runs the example.")


def export_fmu_verb(
    model: ModelArgument,
    out: Annotated[Path, typer.Argument(help="Where the FMU is written.")],
    fmi: Annotated[int, typer.Option(min=2, max=3, help="Version of FMI.")] = 3,
    low: Low = None,
    high: High = None,
    rate_limit: RateLimit = None,
) -> None:
    """Write the compensator as a Co-Simulation FMU with a binary for this machine and its source."""
    from bench.export.fmu import write_fmu

    loaded, settings = _opened(model, low, high, rate_limit, None)
    if out.suffix != ".fmu":
        raise typer.BadParameter(f"{out} does not end in .fmu", param_hint="out")
    if out.exists():
        raise ExportError(f"{out}: is there already; name a new file")
    if not out.parent.is_dir():
        raise ExportError(f"{out}: the folder {out.parent} does not exist")
    write_fmu(loaded, settings, out, fmi)
    console.print(f"FMU: {out}, FMI {fmi}.0 Co-Simulation with a fixed step of {loaded.structure.sample_time:g} s.")


def realtime_verb(
    model: ModelArgument,
    rate: Annotated[float, typer.Option(min=1.0, max=1e6, help="Samples per second.")] = 8000.0,
    seconds: Annotated[float, typer.Option(min=0.01, help="Length of the run.")] = 60.0,
    part: PartChoice = PartOption.compensator,
    solver: SolverChoice = None,
    precision: PrecisionChoice = PrecisionOption.double,
    priority: Annotated[int, typer.Option(min=0, max=99, help="Of SCHED_FIFO; 0 does not ask for it.")] = 80,
    core: Annotated[int | None, typer.Option(min=0, help="Core to run on; the last by default.")] = None,
    search: Annotated[bool, typer.Option("--search", help="Find the highest rate at which 99.99 % are met, too.")] = False,
    out: Annotated[Path | None, typer.Option(help="Where histograms and figures are written, JSON.")] = None,
) -> None:
    """Run the exported C on this machine on an absolute schedule and count its misses."""
    from bench.export.realtime import MET, RealTime, histogram
    from piezo_model.atomic_file import write_text

    loaded, settings = _opened(model, None, None, None, solver, precision=precision.value, part=part.value)
    with RealTime(loaded, settings, priority, core) as machine:
        step, null = machine.run(rate, seconds), machine.run(rate, seconds, null=True)
        best = None
        if search:
            best = machine.highest_rate(rate, told=lambda tried, met: errors.print(f"{tried:.0f} Hz: {100 * met:.3f} % met"))
    for what, said in (("memory", "locking memory"), ("core", "pinning to a core"), ("fifo", "SCHED_FIFO")):
        if step.allowed.get(what) != "yes":
            console.print(f"Without {said}: {step.allowed.get(what, 'not asked for')}.")
    times = {"wake-up": step.wake_ns, "service": step.service_ns, "response": step.response_ns,
             "null response": null.response_ns}
    found = {name: [percentile(1e-3 * part_ns, q) for q in QUANTILES] for name, part_ns in times.items()}
    print_table(("µs", *(p.name for p in found["response"]), "max"),
                [(name, *("–" if p.value is None else f"{p.value:.2f}" for p in row), f"{1e-3 * times[name].max():.2f}")
                 for name, row in found.items()])
    counts = {name: histogram(part_ns) for name, part_ns in times.items()}
    bounds = sorted({bound for count in counts.values() for bound in count})
    print_table(("up to, µs", *counts), [(f"{bound:g}", *(str(count.get(bound, 0)) for count in counts.values()))
                                         for bound in bounds])
    console.print(f"{step.missed} of {step.response_ns.size} deadlines at {rate:g} Hz missed; of a step that does nothing, "
                  f"{null.missed}.")
    if best is not None:
        console.print(f"Highest rate at which {100 * MET:g} % are met: {best:.0f} Hz." if best
                      else f"No rate was found at which {100 * MET:g} % are met.")
    if out is not None:
        figures: dict[str, Any] = {"rate_Hz": rate, "samples": step.response_ns.size, "missed": step.missed,
                                   "null_missed": null.missed, "highest_rate_Hz": best, "allowed": step.allowed,
                                   "histograms_us": {name: {f"{bound:g}": n for bound, n in count.items()}
                                                     for name, count in counts.items()}}
        write_text(out, json.dumps(figures, indent=1) + "\n")
        console.print(f"Figures: {out}")


def _opened(path: Path, low: float | None, high: float | None, rate_limit: float | None, solver: SolverOption | None,
            **options: Any) -> tuple[HysteresisCreepModel, ExportSettings]:
    """Model and settings of a file of identify or deploy."""
    limits, chosen = None, None if solver is None else solver.value
    if _format(path) == FORMAT:
        deployed = Deployment.load(path)
        model, limits = deployed.model, deployed.x_limits
        if chosen is None and options.get("part") == "learning":
            chosen = deployed.solver
            if chosen not in SOLVERS:
                raise ExportError(f"{path}: learns with {chosen}, which has no C export; name one with --solver: "
                                  f"{' or '.join(SOLVERS)}")
    else:
        model = HysteresisCreepModel.load(path)
    s = model.structure
    lowest, highest = limits or (s.x_centre - s.x_scale, s.x_centre + s.x_scale)
    limits = (lowest if low is None else low, highest if high is None else high)
    if rate_limit is not None and not rate_limit > 0.0:
        raise typer.BadParameter(f"the fastest change must be positive, not {rate_limit:g}", param_hint="--rate-limit")
    return model, ExportSettings(solver=cast(Any, chosen or SOLVERS[0]), x_limits=limits, rate_limit=rate_limit, **options)


def _format(path: Path) -> str | None:
    """The format that a JSON file says it has; whoever reads the whole of it says what is wrong with it."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ModelError(f"{path}: there is no such file") from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror})") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: is not a whole JSON file ({error})") from None
    return data.get("format") if isinstance(data, dict) else None
