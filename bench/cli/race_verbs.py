"""Verbs around runs: ``race``, ``resume``, ``report``, ``solvers``."""

from dataclasses import fields, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bench.cli.options import (
    FILE,
    READING_OPTIONS,
    Input,
    Output,
    Time,
    as_text,
    grouped,
    reads_a_recording,
    refuse,
)
from bench.cli.worker_options import Scheduler, WorkerBackend, WorkerCount
from bench.messages.race_error import RaceError
from bench.problems import ProblemSetError
from bench.processes.engine import Backend, Workers
from bench.processes.forked_child import warm_up
from bench.processes.solver_child import SolverChild
from bench.races.kind import DEFAULT, kind_of, kinds, open_run
from bench.races.run_problems import left_out
from bench.report.console import (
    AsJson,
    console,
    errors,
    lines_of,
    print_json,
    print_report,
    print_table,
    progress_bar,
    records,
)
from bench.report.report import Report
from bench.store import Run, RunError
from solvers import Lane, Tier, entries
from solvers.registry import OURS

RESULTS = Path("results")
FEW = 3
"""Problems of each set in a race that asks for nothing else."""
FILE_OF = {"recorded": "recording", "foreign": "folder", "test_set": "test_set"}
"""What a problem set of files is made from; naming the files asks for the set."""

SETTING_OF = {
    "problem_set": "problem_sets",
    "scaling": "scalings",
    "tier": "tiers",
    "settings": "settings_run",
    "limit": "limit",
    "budget": "effort",
    "repeats": "repeats",
    **dict.fromkeys(("recording", "time", "input", "output", "folder", "test_set", *READING_OPTIONS), "set_options"),
}
"""Which setting of a race an option goes into that not every kind of race goes by; what a kind declares itself has the
same name."""


class Scale(StrEnum):
    """Scalings, as an option: a list of them cannot be one of a ``Literal``."""

    scaled = "scaled"
    raw = "raw"


if TYPE_CHECKING:
    KindName = str
else:
    KindName = Literal[*kinds()]


def own_options() -> dict[str, Any]:
    """The options that kinds of race declare in their settings, by name."""
    declared = {
        field.name: field for kind in kinds().values() for field in fields(kind.settings) if "help" in field.metadata
    }
    return {
        name: Annotated[
            type(field.default) | None,
            typer.Option(
                min=field.metadata["least"], help=f"{field.metadata['help'].rstrip('.')}; {field.default} by default."
            ),
        ]
        for name, field in declared.items()
    }


def race_help() -> str:
    """What the kinds of race are."""
    *some, last = (f"{kind.summary} ({name})" for name, kind in kinds().items())
    what = ", ".join(some) + f", or {last}."
    return what[0].upper() + what[1:]


def refuse_unused(context: typer.Context, kind: str) -> None:
    """Refuse an option for a setting that this kind of race does not have, or has fixed."""
    open_settings = {
        name: {field.name for field in fields(each.settings) if field.init} for name, each in kinds().items()
    }
    for option, setting in {**SETTING_OF, **{name: name for name in own_options()}}.items():
        if setting not in open_settings[kind]:
            users = [name for name, settings in open_settings.items() if setting in settings]
            refuse(context, [option], f"is for the race {' or '.join(users)}; the race {kind} does not use it")


@reads_a_recording
@grouped("own", own_options())
def race_verb(
    context: typer.Context,
    reading: dict[str, Any],
    own: dict[str, int | None],
    kind: Annotated[KindName, typer.Option("--race", help=race_help())] = DEFAULT,
    problem_set: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Problem set, paper and measured by default; "
            "may be given again. A stream, a loop and a batch have their own problems.",
        ),
    ] = None,
    solver: Annotated[
        list[str] | None,
        typer.Option(help="Name of a solver, or a file.py with one of your own; may be given again. All by default."),
    ] = None,
    lane: Annotated[
        list[Lane] | None,
        typer.Option(
            help="How solvers are called: compiled, by their own object, "
            "through qpsolvers or cvxpy, as generated C; may be given again. All but codegen by default."
        ),
    ] = None,
    tier: Annotated[
        list[Tier] | None,
        typer.Option(
            help="Of a stream or a loop, what answers must reach: a cost gap "
            "of 1e-3 (low), 1e-6, 1e-9 or 1e-12 (exact), what the stage does not notice, or what the library "
            "does by default; may be given again. high by default."
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        typer.Option(
            help="Of a stream or a loop, the one-shot race whose settings "
            "solvers get; those of the reference run by default."
        ),
    ] = None,
    scaling: Annotated[
        list[Scale] | None,
        typer.Option(help="P with a unit diagonal, or volts and micrometres as they come; both by default."),
    ] = None,
    limit: Annotated[
        int | None,
        typer.Option(
            min=0, help="Problems of each set, 0 for all; 3 by default, and all where sets or files are named."
        ),
    ] = None,
    recording: Annotated[Path | None, typer.Option(help=f"To make problems of, the set recorded. {FILE}")] = None,
    time: Time = None,
    input: Input = None,
    output: Output = None,
    folder: Annotated[
        Path | None, typer.Option(help="Folder of NPZ, MAT, QPS and MPS files to race on, the set foreign.")
    ] = None,
    test_set: Annotated[
        Path | None, typer.Option(help="Python file with a test set of qpbenchmark to race on.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Everything random follows from it.")] = 0,
    budget: Annotated[float, typer.Option(min=0.0, help="Seconds of timing for each task.")] = 0.005,
    time_limit: Annotated[float, typer.Option(min=0.1, help="Seconds for each task, everything included.")] = 20.0,
    memory: Annotated[int, typer.Option(min=16, help="Megabytes that a solver may allocate.")] = 2048,
    repeats: Annotated[int, typer.Option(min=1, help="Fresh processes for each solver.")] = 1,
    workers: WorkerCount = 1,
    backend: WorkerBackend = Backend.LOCAL,
    scheduler: Scheduler = "",
    out: Annotated[Path, typer.Option(help="Folder of the runs.")] = RESULTS,
    name: Annotated[str | None, typer.Option(help="Name of this run; the time by default.")] = None,
    as_json: AsJson = False,
) -> None:
    """Race solvers: who is right, and how fast.

    Every answer is judged against an optimum that is proven in exact arithmetic. The run is a folder with a report.
    """
    race = kinds()[kind]
    refuse_unused(context, kind)
    names, solver_files = _names_and_files(solver or [])
    files = {"recording": recording, "folder": folder, "test_set": test_set}
    said = as_text(
        **{name: path and path.resolve() for name, path in files.items()},
        time=time,
        input=input,
        output=output,
        **reading,
    )
    sets = problem_set or [name for name, option in FILE_OF.items() if option in said]
    lists: dict[str, Any] = {
        "problem_sets": sets,
        "lanes": lane,
        "tiers": tier,
        "scalings": [choice.value for choice in scaling or ()],
    }
    values: dict[str, Any] = {
        "solvers": names,
        "solver_files": solver_files,
        "limit": FEW if limit is None and race.schema is kinds()[DEFAULT].schema and not sets else limit,
        "seed": seed,
        "time_limit_s": time_limit,
        "memory_mb": memory,
        "settings_run": settings and str(settings.resolve()),
        "effort": replace(race.settings().effort, budget_s=budget),
        "repeats": repeats,
        "set_options": said,
        **{name: tuple(asked) for name, asked in lists.items() if asked},
        **own,
    }
    made = race.settings(
        **{
            field.name: values[field.name]
            for field in fields(race.settings)
            if field.init and values.get(field.name) is not None
        }
    )
    spread = Workers(workers, backend, scheduler)
    race.check(spread)
    run = race.start(out, made, name)
    try:
        _finish(run, spread, as_json)
    except (RaceError, ProblemSetError):
        run.discard()
        raise


def resume_verb(
    run: Annotated[Path, typer.Argument(help="Folder of the run.")],
    workers: WorkerCount = 1,
    backend: WorkerBackend = Backend.LOCAL,
    scheduler: Scheduler = "",
    as_json: AsJson = False,
) -> None:
    """Carry on with an interrupted race; what is done is kept."""
    opened = open_run(run)
    if opened.is_finished(kind_of(opened).schema):
        if not as_json:
            console.print(f"{run} is finished already.")
        report_verb(run, as_json)
    else:
        spread = Workers(workers, backend, scheduler)
        kind_of(opened).check(spread)
        _finish(opened, spread, as_json)


def report_verb(run: Annotated[Path, typer.Argument(help="Folder of the run.")], as_json: AsJson = False) -> None:
    """Write the report of a run again, and show its verdict."""
    opened = open_run(run)
    with progress_bar() as progress:
        progress("writing the report", 0, 1)
        found = kind_of(opened).write(opened)
    _show(opened, *found, as_json)


def solvers_verb(as_json: AsJson = False) -> None:
    """List every solver in every lane, or why it is absent."""
    known = list(entries())
    warm_up(known)
    children = [SolverChild(entry) for entry in known]
    rows = []
    with progress_bar() as progress:
        for done, child in enumerate(children):
            progress(child.entry.name, done, len(children))
            with child:
                found = child.describe()
            rows.append(
                (
                    found.name,
                    str(found.lane),
                    found.algorithm,
                    found.version,
                    found.licence,
                    "yes" if found.warm_start else "no",
                )
                if not found.absent
                else (found.name, str(found.lane), f"absent: {found.absent}", "", "", "")
            )
    headings = ("solver", "lane", "algorithm", "version", "licence", "warm start")
    if as_json:
        print_json(records(headings, rows))
    else:
        print_table(headings, rows, left=6)
        console.print(
            f"Ours, written for this project: {', '.join(sorted(OURS.intersection(row[0] for row in rows)))}."
        )


def _names_and_files(asked: list[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    files = tuple(str(Path(text).resolve()) for text in asked if text.endswith(".py"))
    return tuple(text for text in asked if not text.endswith(".py")), files


def _finish(run: Run, workers: Workers, as_json: bool) -> None:
    resume = f"what is done is kept, and 'piezobench resume {run.path}' carries on"
    try:
        with progress_bar() as progress:
            kind_of(run).carry_on(run, progress, workers)
            progress("writing the report", 0, 1)
            found = kind_of(run).write(run)
    except OSError as error:
        raise RunError(f"{run.path}: {error.strerror or error}; {resume}") from None
    except KeyboardInterrupt:
        errors.print(f"Interrupted; {resume}.", soft_wrap=True)
        raise
    _show(run, *found, as_json)


def _cut(run: Run) -> list[str]:
    """How many problems were raced, where there are more."""
    raced, there_are = (
        {name: len(found) for name, found in run.settings.get("problems", {}).items()},
        run.settings.get("there_are", {}),
    )
    return (
        [f"{sum(raced.values())} of {sum((raced | there_are).values())} problems were raced; --limit 0 races all."]
        if there_are
        else []
    )


def _show(run: Run, found: Report, path: Path, as_json: bool) -> None:
    """The first screen, in 100 columns and 40 lines, then what was left out, and where the rest is."""
    if as_json:
        print_json(
            {
                "run": run.path,
                "report": path,
                "page": path.with_suffix(".html"),
                "left_out": dict(left_out(run)),
                **found.document,
            }
        )
        return
    excluded, absent = left_out(run), run.settings.get("absent")
    missing = ", ".join(absent) if absent and len(absent) <= 3 else f"{len(absent or ())} solver lanes"
    below = lines_of(
        [
            *([f"Absent, so not raced: {missing} (run.json says why)."] if absent else []),
            *run.settings.get("conditions", {}).get("warnings", []),
        ]
    )
    below += lines_of(_cut(run))
    if excluded:
        count = len(excluded) + sum(map(len, run.settings["problems"].values()))
        below += [
            "",
            f"Not raced, {len(excluded)} of {count} problems:",
            *(f"{problem}: {why}" for problem, why in excluded),
        ]
    print_report(found, below)
    console.print(f"Page: {path.with_suffix('.html')}\nReport: {path}")
