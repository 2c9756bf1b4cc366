"""The solver lanes of a race: those that are selected, and those of them that run here."""

import os
import re

from bench.messages.task import RaceError
from bench.problems import ProblemSetError, check_options, make
from bench.processes.child_process import warm_up
from bench.processes.solver_child import SolverPool, entry_of_file
from bench.races import null_solver
from bench.races.settings import RaceSettings
from bench.store import Run
from piezo_model.checks import check
from solvers import Described, Entry, Lane, entries


def chosen(settings: RaceSettings) -> list[Entry]:
    """The entries selected by name and lane, and those of the user's files, each of which is loaded in a separate
    process."""
    known = list(entries())
    names = {entry.name for entry in known}
    for unknown in sorted(set(settings.solvers) - names):
        raise RaceError(f"there is no solver {unknown!r}; known are {', '.join(sorted(names))}")
    selected = [
        entry
        for entry in known
        if entry.lane in settings.lanes and (not settings.solvers or entry.name in settings.solvers)
    ]
    warm_up(selected)
    for path in settings.solver_files:
        entry = entry_of_file(path)
        check(
            re.fullmatch(r"\w[\w.+-]*", entry.name),  # it becomes part of file names
            f"{path}: a solver is named with letters, digits, '_', '.', '+' and '-', and not {entry.name!r}",
            RaceError,
        )
        check(
            entry.lane is not Lane.KERNEL,
            f"{path}: is not timed inside compiled code, as the solvers in the lane kernel are; its lane is direct",
            RaceError,
        )
        check(  # in no lane may it pass for the floor or for a known solver
            entry.name not in {*names, null_solver.ENTRY.name}
            and not any((other.name, other.lane) == (entry.name, entry.lane) for other in selected),
            f"{path}: there is a solver {entry.name} already; name it otherwise",
            RaceError,
        )
        selected.append(entry)
    check(selected, f"no selected solver is in the lane {' or '.join(settings.lanes)}", RaceError)
    return selected


def checked(settings: RaceSettings) -> list[Entry]:
    """The solvers selected by the settings; RaceError, RunError or ProblemSetError if the race cannot be run."""
    check_options(settings.problem_sets, settings.set_options)
    sets = [make(problem_set, settings.seed, settings.set_options) for problem_set in settings.problem_sets]
    if settings.problems:
        names = {problem_set.name: problem_set.names() for problem_set in sets}
        known = {
            name
            for set_name, of_set in names.items()
            for problem in of_set
            for name in (problem, f"{set_name}/{problem}")
        }
        if missing := [name for name in settings.problems if name not in known]:
            listed = "; ".join(f"{set_name}: {', '.join(of_set)}" for set_name, of_set in names.items())
            raise ProblemSetError(f"there is no problem {missing[0]!r} in these sets; {listed}")
    selected = chosen(settings)
    for name in settings.given.keys() - {entry.name for entry in selected}:
        raise RaceError(f"settings are given for {name!r}, which does not race")
    return selected


def described_by(run: Run, pool: SolverPool) -> list[Described]:
    """The solvers, described where they run. RaceError if one has another version than in the run: resumed or spread
    over machines, a run has one version of each solver lane."""
    described = [child.describe() for child in pool.children.values() if child.entry is not null_solver.ENTRY]
    recorded = run.settings.get("lanes", {})
    for solver in described:
        was = recorded.get(lane := f"{solver.name} ({solver.lane})", solver.version)
        check(
            solver.absent or _release(was) == _release(solver.version),
            f"{run.path} raced {lane} in version {was}, and {os.uname().nodename} has {solver.version}; begin a new "
            "run",
            RaceError,
        )
    return described


def _release(version: str) -> str:
    """A version without the compiler and its flags."""
    return version.partition(",")[0]


def lanes_here(run: Run, pool: SolverPool) -> list[Described]:
    """The solvers that run here, noted in the run; RaceError if no solver runs, one selected by name runs in no lane,
    or one has another version than in the run."""
    described, before = described_by(run, pool), run.settings
    lanes = [solver for solver in described if not solver.absent]
    versions = {f"{solver.name} ({solver.lane})": solver.version for solver in lanes}
    absent = {f"{solver.name} ({solver.lane})": solver.absent for solver in described if solver.absent}
    own = {  # 1e-9 at the finest: rungs may ask for more than rounding allows
        f"{solver.name} ({solver.lane})": 10.0 ** (1 - min((10.0, *map(abs, solver.exponents[-1:]))))
        for solver in described
        if pool.children[solver.name, solver.lane].entry.path
    }
    run.note(lanes=versions | before.get("lanes", {}), absent=before.get("absent", {}) | absent, own=own)
    present = {solver.name for solver in lanes}
    for solver in described:
        check(
            solver.name in present or solver.name not in before["settings"]["solvers"],
            f"the selected solver {solver.name} is absent: {solver.absent}",
            RaceError,
        )
    check(lanes, f"no selected solver runs here; {described[0].name}: {described[0].absent}", RaceError)
    return lanes
