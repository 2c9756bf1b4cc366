"""Verbs around runs: ``race``, ``resume``, ``report``, ``solvers``."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.cli.options import SET_OPTIONS, AsJson, Seed, check_option, grouped, on_workers, set_options
from bench.messages.task import RaceError
from bench.problems import ProblemSetError, all_sets
from bench.processes import engine
from bench.processes.solver_child import STANDARD, SolverPool
from bench.races.run_problems import left_out
from bench.races.runs import carry_on, open_run, settings_of, start, write
from bench.races.settings import RaceSettings
from bench.report.console import console, lines_of, print_report, print_result, progress_bar, resumable
from bench.report.words import by_heading, solver_lanes
from bench.store import Run, RunError
from bench.timing import machine
from bench.timing.clock import Effort
from piezo_model.json_file import decoded
from solvers import Lane, entries
from solvers.registry import OURS

FEW = 3
"""Default number of problems of each set, if neither sets nor files are named."""

Scale = StrEnum("Scale", ["scaled", "raw"])
"""Scalings; typer takes a list of an enumeration but not of a ``Literal``."""


NUMBERS: dict[str, Any] = {
    field.name: Annotated[
        type(field.default) | None,
        typer.Option(
            limits.extra["flag"] or f"--{field.name.replace('_', '-')}",
            metavar=limits.extra["metavar"],
            min=limits.ge,
            max=limits.le,
            help=f"{limits.description}; {field.default:g} by default.",
        ),
    ]
    for field in fields(RaceSettings)
    for limits in getattr(field.type, "__metadata__", ())
    if limits.extra
}
"""Options that the settings of a race declare."""


@on_workers
@grouped("options", SET_OPTIONS, set_options)
@grouped("own", NUMBERS)
def race_verb(
    options: dict[str, str],
    own: dict[str, float | None],
    workers: engine.Workers,
    problem_sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="SET",
            help="Problem set, repeatable; by default paper and measured, or those of a given "
            "--recording, --folder or --test-set.",
        ),
    ] = None,
    problems: Annotated[
        list[str] | None,
        typer.Option(
            "--problem", metavar="NAME", help="Problem by name, repeatable; piezobench problems --set SET lists them."
        ),
    ] = None,
    solvers: Annotated[
        list[str] | None,
        typer.Option(
            "--solver", metavar="NAME", help="Solver by name, or a file.py with your own, repeatable; all by default."
        ),
    ] = None,
    lanes: Annotated[
        list[Lane] | None,
        typer.Option(
            "--lane",
            metavar="|".join(Lane),
            help="How solvers are called, repeatable: from compiled code (kernel), by their own Python "
            "object (direct), through qpsolvers or through cvxpy; all by default.",
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOLVER={...}",
            help="Settings of a solver to measure beside its defaults, in place of its ladder, repeatable: "
            "SOLVER='{\"eps_abs\": 1e-6}'.",
        ),
    ] = None,
    scalings: Annotated[
        list[Scale] | None,
        typer.Option(
            "--scaling",
            metavar="scaled|raw",
            help="Scaling of the problems, repeatable: scaled to a unit diagonal of P, or raw in volts and "
            "micrometres; both by default.",
        ),
    ] = None,
    limit: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Problems of each set, evenly spread over it, 0 for all; 3 by default, and all if sets or files are "
            "named.",
        ),
    ] = None,
    seed: Seed = 0,
    budget: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, help="Duration of the timed calls of a task.")
    ] = 0.005,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder that holds the runs.")] = Path("results"),
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the run; date and time by default.")] = None,
    as_json: AsJson = False,
) -> None:
    """Race solvers and compare their accuracy and speed.

    Every answer is compared with an optimum that is proven in exact arithmetic. The run is a folder with a report. The
    exit status is 1 if a solver of a file of your own fails, or errs by more than it states: 1e-9, or ten times what
    the exponent of its finest setting says if that is more.
    """
    sets = problem_sets or [name for name, made in all_sets().items() if not options.keys().isdisjoint(made.needs)]
    chosen: dict[str, Any] = {
        "problem_sets": sets,
        "problems": problems,
        "solvers": [text for text in solvers or () if not text.endswith(".py")],
        "solver_files": [str(Path(text).resolve()) for text in solvers or () if text.endswith(".py")],
        "lanes": lanes,
        "scalings": [scale.value for scale in scalings or ()],
        "limit": FEW if limit is None and not sets else limit,
        "seed": seed,
        "effort": Effort(budget_s=budget),
        "set_options": options,
        "given": _settings_by_solver(settings or []),
        **own,
    }
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in chosen.items()
        if value not in (None, [])
    }
    made = RaceSettings(**values)
    workers.check()
    run = start(out, made, datetime.now(UTC).strftime("%Y%m%d-%H%M%S") if name is None else name)
    try:
        _finish(run, workers, as_json, made.code)
    except (RaceError, ProblemSetError):
        run.discard()
        raise


def _settings_by_solver(texts: Sequence[str]) -> dict[str, str]:
    """Settings by solver, as JSON; refused if they are no JSON or given twice."""
    by_solver: dict[str, str] = {}
    for solver, _, text in (setting.partition("=") for setting in texts):
        check_option(solver not in by_solver, "--settings", f"{solver}: takes one setting, got several")
        try:
            decoded(text, dict[str, Any])
        except ValueError as error:
            raise typer.BadParameter(
                f"{solver}: must be SOLVER={{...}} with settings in JSON: {error}", param_hint="--settings"
            ) from None
        by_solver[solver] = text
    return by_solver


@on_workers
def resume_verb(
    run: Annotated[Path, typer.Argument(help="Folder of the run.")],
    workers: engine.Workers,
    code: Annotated[
        list[Path] | None,
        typer.Option(
            "--solver",
            "--test-set",
            metavar="FILE.py",
            help="Python file that the race was given with this option, repeatable. A run folder is data: it does not "
            "choose the code that runs.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Continue an interrupted race; finished tasks are kept."""
    opened = open_run(run)
    if opened.is_finished():
        if not as_json:
            console.print(f"{run} is finished already.")
        report_verb(run, as_json)
    else:
        used = settings_of(opened).code
        for file in sorted(used ^ {str(path.resolve()) for path in code or ()}):
            raise RunError(
                f"{run / 'run.json'} names the Python file {file}, whose code would run; if you trust it, add "
                f"--solver {file}"
                if file in used
                else f"{run}: the race did not use {file}"
            )
        if len(rows := opened.rows_so_far()):
            opened.check_machines(rows, "parts")
        _finish(opened, workers, as_json, used)


def report_verb(run: Annotated[Path, typer.Argument(help="Folder of the run.")], as_json: AsJson = False) -> None:
    """Write the report of a run again and show its verdict."""
    opened = open_run(run)
    with progress_bar("writing the report"):
        report, path = write(opened)
    page, excluded, settings = path.with_suffix(".html"), left_out(opened), opened.settings
    absent, in_sets = settings.get("absent", {}), settings.get("there_are", {})
    raced = {name: len(problems) for name, problems in settings.get("problems", {}).items()}
    count, total = sum(raced.values()), sum((raced | in_sets).values())
    below = lines_of(
        [
            f"Absent, so not raced: {solver_lanes(len(absent))} (run.json says why)." if absent else "",
            *settings.get("conditions", {}).get("warnings", []),
            *machine.elsewhere(f"The run {opened.path.name}", opened.machine_names),
            f"{count} of {total} problems were raced; --limit 0 races all."
            if in_sets and not settings["settings"].get("problems")
            else "",
        ]
    )
    if excluded:
        below += ["", f"Not raced, {len(excluded)} of {len(excluded) + count} problems:", *map(": ".join, excluded)]
    print_report(
        report,
        {"run": run, "report": path, "page": page, "left_out": dict(excluded), **report.document},
        as_json,
        below,
        [f"Page: {page}", f"Report: {path}", *filter(None, [report.failed])],
    )
    if report.failed:
        raise typer.Exit(1)


def solvers_verb(as_json: AsJson = False) -> None:
    """List all solvers in all lanes, or why one is absent."""
    rows = []
    with progress_bar() as progress, SolverPool(list(entries()), STANDARD) as pool:
        for done, child in enumerate(pool.children.values()):
            progress(child.entry.name, done, len(pool.children))
            info = child.describe()
            rows.append(
                (
                    info.name,
                    str(info.lane),
                    info.algorithm,
                    info.version,
                    info.licence,
                    "yes" if info.warm_start else "no",
                )
                if not info.absent
                else (info.name, str(info.lane), f"absent: {info.absent}", "", "", "")
            )
    headings = ("solver", "lane", "algorithm", "version", "licence", "warm start")
    ours = f"Ours, written for this project: {', '.join(sorted(OURS.intersection(row[0] for row in rows)))}."
    print_result(by_heading(headings, rows), as_json, (headings, rows, 6), ours)


def _finish(run: Run, workers: engine.Workers, as_json: bool, code: Iterable[str]) -> None:
    """Do the rest of a race, and show its report; an interrupted one is continued with these Python files."""
    words = ["piezobench", "resume", str(run.path), *(word for file in sorted(code) for word in ("--solver", file))]
    with resumable(str(run.path), f"finished tasks are kept; run '{shlex.join(words)}' to continue", RunError):
        with progress_bar() as progress:
            carry_on(run, progress, workers)
        report_verb(run.path, as_json)
