"""Verbs around runs: ``race``, ``resume``, ``report``, ``solvers``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from bench import race
from bench.cli.console import console, errors, print_table, progress_bar
from bench.clock import Effort
from bench.isolation import Child
from bench.report import figures, markdown
from bench.store import Run, RunError
from solvers import Lane, Tier, entries

RESULTS = Path("results")


class Scale(StrEnum):
    """Scalings, as an option."""

    scaled = "scaled"
    raw = "raw"


def register(app: typer.Typer) -> None:
    """Add the verbs."""
    app.command("race")(race_verb)
    app.command("resume")(resume_verb)
    app.command("report")(report_verb)
    app.command("solvers")(solvers_verb)


def race_verb(
    problem_set: Annotated[list[str] | None, typer.Option("--set", help="Problem set; may be given again.")] = None,
    solver: Annotated[list[str] | None, typer.Option(help="Name of a solver, or a file.py with one of your own; may be "
                                                          "given again. All by default.")] = None,
    lane: Annotated[list[Lane] | None, typer.Option(help="Lane; may be given again. All by default.")] = None,
    tier: Annotated[list[Tier] | None, typer.Option(help="Accuracy asked for; may be given again.")] = None,
    scaling: Annotated[list[Scale] | None, typer.Option(help="May be given again. Both by default.")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Problems of each set; all by default.")] = None,
    seed: Annotated[int, typer.Option(help="Everything random follows from it.")] = 0,
    budget: Annotated[float, typer.Option(min=0.0, help="Seconds of timing for each task.")] = 0.02,
    time_limit: Annotated[float, typer.Option(min=0.1, help="Seconds for each task, everything included.")] = 20.0,
    memory: Annotated[int, typer.Option(min=16, help="Megabytes that a solver may allocate.")] = 2048,
    out: Annotated[Path, typer.Option(help="Folder of the runs.")] = RESULTS,
    name: Annotated[str | None, typer.Option(help="Name of this run; the time by default.")] = None,
) -> None:
    """Race solvers on certified problems and report who is right and how fast."""
    names, files = _names_and_files(solver or [])
    settings = race.RaceSettings(
        tuple(problem_set or ["paper"]), names, tuple(lane or Lane), tuple(tier or (Tier.DEFAULT, Tier.HIGH)),
        tuple(choice.value for choice in scaling or Scale), limit, seed, Effort(budget_s=budget), time_limit, memory,
        files)
    _finish(race.start(out, settings, name))


def resume_verb(run: Annotated[Path, typer.Argument(help="Folder of the run.")]) -> None:
    """Carry on with a race that was interrupted."""
    opened = Run.open(run)
    if opened.is_finished():
        console.print(f"{run} is finished already.")
        report_verb(run)
    else:
        _finish(opened)


def report_verb(run: Annotated[Path, typer.Argument(help="Folder of the run.")]) -> None:
    """Write the report of a run again and show its verdict."""
    opened = Run.open(run)
    path = markdown.write(opened)
    _show(opened, path)


def solvers_verb() -> None:
    """List every solver in every lane, or why it is absent."""
    children = [Child(entry) for entry in entries()]
    rows = []
    for child in children:
        with child:
            found = child.describe()
            rows.append((found.name, str(found.lane), found.algorithm, found.version, found.licence,
                         "yes" if found.warm_start else "no") if not found.absent
                        else (found.name, str(found.lane), f"absent: {found.absent}", "", "", ""))
    print_table(("solver", "lane", "algorithm", "version", "licence", "warm start"), rows, left=6)


def _names_and_files(asked: list[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    files = tuple(str(Path(text).resolve()) for text in asked if text.endswith(".py"))
    return tuple(text for text in asked if not text.endswith(".py")), files


def _finish(run: Run) -> None:
    resume = f"what is done is kept, and 'piezobench resume {run.path}' carries on"
    try:
        with progress_bar() as progress:
            race.carry_on(run, progress)
        report = markdown.write(run)
    except OSError as error:
        raise RunError(f"{run.path}: {error.strerror or error}; {resume}") from None
    except KeyboardInterrupt:
        errors.print(f"Interrupted; {resume}.")
        raise
    _show(run, report)


def _show(run: Run, report: Path) -> None:
    """Verdict first, then the table, then where the rest is."""
    rows = run.rows()
    table = figures.summary(rows)
    for sentence in figures.verdict(rows).sentences:
        console.print(sentence)
    for (problem_set, scaling), part in table.groupby(["problem_set", "scaling"], sort=False):
        best = part.sort_values("tier", key=lambda tiers: tiers != "high").drop_duplicates(["solver", "lane", "settings"])
        console.print(f"\n{problem_set}, {scaling} data, the most exact tier of each:")
        headings = {key: text for key, text in markdown.HEADINGS.items()
                    if key not in ("worst_primal_residual", "worst_dual_residual", "solve_us_max")}
        print_table(list(headings.values()), [[markdown.cell(row, key) for key in headings]
                    for _, row in best.sort_values(["all_right", "total_us"], ascending=[False, True]).iterrows()], left=4)
    if absent := run.settings.get("absent"):
        console.print(f"\nNot raced, since absent here (piezobench solvers says why): {', '.join(absent)}")
    console.print(f"\nReport: {report}")
