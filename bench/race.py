"""The one-shot race: every problem, in each scaling, by every solver in every lane at each tier.

For each problem and scaling the solvers take turns, each in its own process on the same core, and every finished task
is on disk before the next one starts.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from bench import machine
from bench.clock import Effort
from bench.isolation import Child, entry_of_file, warm_up
from bench.metrics import judge
from bench.problems import find as find_set
from bench.problems.protocol import SCALINGS, RaceProblem
from bench.store import Run, RunError
from bench.task import Task
from bench.worker import Outcome
from piezo_model.identification_problem import Scaling
from solvers import Lane, Tier, entries
from solvers.registry import Described, Entry

Progress = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done, and how much there is."""

PERIOD_US = 125.0
"""The paper's sampling period."""


class RaceError(ValueError):
    """What is asked for cannot be raced; the message is one sentence that says why."""


@dataclass(frozen=True)
class RaceSettings:
    """What is raced and how; stored with the run, so that it can be resumed."""

    problem_sets: tuple[str, ...] = ("paper",)
    solvers: tuple[str, ...] = ()
    """Names to race; empty for all."""
    lanes: tuple[Lane, ...] = tuple(Lane)
    tiers: tuple[Tier, ...] = (Tier.DEFAULT, Tier.HIGH)
    scalings: tuple[Scaling, ...] = SCALINGS
    limit: int | None = None
    """Number of problems of each set; None for all."""
    seed: int = 0
    effort: Effort = field(default_factory=Effort)
    time_limit_s: float = 20.0
    memory_mb: int = 2048
    solver_files: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Settings as JSON can hold them."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Make the settings of :meth:`to_dict`."""
        tuples = {name: tuple(value) for name, value in data.items() if isinstance(value, list)}
        lanes, tiers = tuple(Lane(x) for x in data["lanes"]), tuple(Tier(x) for x in data["tiers"])
        return cls(**{**data, **tuples, "lanes": lanes, "tiers": tiers, "effort": Effort(**data["effort"])})


Settings = TypeVar("Settings", bound=RaceSettings)


def entries_of(settings: RaceSettings) -> list[Entry]:
    """The entries that are asked for, by name and lane; those of the user's own files always are."""
    known = list(entries())
    names = {entry.name for entry in known}
    unknown = sorted(set(settings.solvers) - names)
    if unknown:
        raise RaceError(f"there is no solver {unknown[0]!r}; known are {', '.join(sorted(names))}")
    chosen = [entry for entry in known
              if entry.lane in settings.lanes and (not settings.solvers or entry.name in settings.solvers)]
    taken = {(entry.name, entry.lane) for entry in known}
    for path in settings.solver_files:
        try:
            entry = entry_of_file(path)
        except ImportError as error:
            raise RaceError(str(error)) from None
        if not re.fullmatch(r"\w[\w.+-]*", entry.name):  # it becomes part of file names
            raise RaceError(f"{path}: a solver is named with letters, digits, '_', '.', '+' and '-', and not {entry.name!r}")
        if (entry.name, entry.lane) in taken:
            raise RaceError(f"{path}: there is a solver {entry.name} in the lane {entry.lane} already; name it otherwise")
        taken.add((entry.name, entry.lane))
        chosen.append(entry)
    if not chosen:
        raise RaceError(f"no solver of those asked for is in the lane {' or '.join(settings.lanes)}")
    return chosen


def tasks_of(settings: RaceSettings, field: Sequence[Described], problem: RaceProblem, scaling: Scaling,
             ) -> Iterator[Task]:
    """All tasks of one problem in one scaling; a solver with variants shows those at the first tier only."""
    for solver in field:
        for tier in settings.tiers if solver.variants == ({},) else settings.tiers[:1]:
            for variant in solver.variants:
                yield Task(problem.set_name, problem.name, scaling, solver.name, solver.lane, tier, variant)


@contextmanager
def started(chosen: Sequence[Entry], settings: RaceSettings, core: int) -> Iterator[list[Child]]:
    """The processes of the field, all starting at once."""
    with ExitStack() as stack:
        yield [stack.enter_context(Child(entry, settings.time_limit_s, settings.memory_mb, core)) for entry in chosen]


def checked(settings: RaceSettings) -> list[Entry]:
    """The entries that are asked for; RaceError unless there is all that is asked for."""
    for problem_set in settings.problem_sets:
        try:
            find_set(problem_set)
        except KeyError as error:
            raise RaceError(str(error.args[0])) from None
    return entries_of(settings)


def start(results: Path, settings: RaceSettings, name: str | None = None, kind: str = "oneshot") -> Run:
    """Make the run's folder."""
    checked(settings)
    return Run.create(results, {"race": kind, "settings": settings.to_dict(), "machine": machine.describe()}, name)


def carry_on(run: Run, progress: Progress) -> None:
    """Do whatever is not done yet and gather the tables."""
    settings = settings_of(run)
    with run.alone():
        warm_up()
        chosen = checked(settings)
        problems = list(problems_of(run, settings, progress))
        _race(run, settings, chosen, problems, progress)
        progress("gathering the tables", 0, 1)
        run.finish()


def settings_of(run: Run, kind: type[Settings] = RaceSettings) -> Settings:  # type: ignore[assignment]
    """The settings that a run was started with."""
    try:
        return kind.from_dict(run.settings["settings"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RunError(f"{run.path / 'run.json'}: does not hold the settings of a race ({error!r})") from None


def _race(run: Run, settings: RaceSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
          progress: Progress) -> None:
    """Do the tasks that are not done."""
    with started(chosen, settings, max(os.sched_getaffinity(0))) as processes:
        field, children = field_of(run, processes)
        tasks = [(problem, task) for problem in problems for scaling in settings.scalings
                 for task in tasks_of(settings, field, problem, scaling)]
        for done, (problem, task) in enumerate(tasks):
            progress(f"{task.solver} ({task.lane}) on {problem.name}, {task.scaling}", done, len(tasks))
            if not run.is_done(task):
                outcome = children[task.solver, task.lane].run(task, problem.forms[task.scaling].qp, settings.effort)
                run.save(task, row_of(problem, task, outcome), times_of(outcome))


def field_of(run: Run, processes: Sequence[Child]) -> tuple[list[Described], dict[tuple[str, Lane], Child]]:
    """The solvers that run here, noted in the run, and the processes by name and lane; RaceError where there is none."""
    described = [child.describe() for child in processes]
    field = [solver for solver in described if not solver.absent]
    run.note_field({f"{solver.name} ({solver.lane})": solver.version for solver in field},
                   {f"{solver.name} ({solver.lane})": solver.absent for solver in described if solver.absent})
    if not field:
        raise RaceError(f"none of the solvers asked for runs here; {described[0].name}: {described[0].absent}")
    return field, {(child.entry.name, child.entry.lane): child for child in processes}


def problems_of(run: Run, settings: RaceSettings, progress: Progress) -> Iterator[RaceProblem]:
    """Make the problems and keep them, or load those that were kept."""
    for set_name in settings.problem_sets:
        made = find_set(set_name)(settings.seed)
        count = min(len(made), settings.limit or len(made))
        for i, problem in enumerate(islice(made.problems(), count)):
            progress(f"certified {problem.set_name}/{problem.name}", i + 1, count)
            path = run.problem_path(problem.set_name, problem.name)
            if not path.is_file():
                problem.save(path)
            yield RaceProblem.load(path)  # what is raced is what is kept, whoever resumes it with whatever versions


def times_of(outcome: Outcome) -> dict[str, Any]:
    """Raw nanoseconds by what was timed."""
    return {"setup": outcome.setup_ns, "update": outcome.update_ns, "solve": outcome.solve_ns}


def row_of(problem: RaceProblem, task: Task, outcome: Outcome) -> dict[str, Any]:
    """The row of a task: who, what, how right and how fast.

    ``periods`` is what the answer takes in sampling periods: the steps of a method that does one step a sample, else
    the median of update and solve over 125 µs.
    """
    verdict = judge(problem, task.scaling, task.tier, outcome)
    solve, update = outcome.solve_ns / 1e3, outcome.update_ns / 1e3
    timed = solve.size > 0
    steps = task.settings.get("steps")
    span_um = problem.validation.span_um if problem.validation is not None else float("nan")
    return {
        "task": task.key, "problem_set": task.problem_set, "problem": task.problem, "d": problem.d,
        "solver": task.solver, "lane": str(task.lane), "tier": str(task.tier), "scaling": task.scaling,
        "settings": json.dumps(dict(task.settings)), **asdict(verdict), "status": str(verdict.status),
        "model_error_um": verdict.model_error_percent / 100.0 * span_um,
        "noise_um": problem.validation.noise_um if problem.validation is not None else float("nan"),
        "setup_us": _median(outcome.setup_ns / 1e3), "update_us": _median(update), "solve_us_p50": _median(solve),
        "solve_us_p99": float(np.percentile(solve, 99)) if timed else float("nan"),
        "solve_us_max": float(solve.max()) if timed else float("nan"), "samples": int(solve.size),
        "periods": float(steps) if steps else (_median(update) + _median(solve)) / PERIOD_US,
        "reported_us": outcome.reported_us, "iterations": outcome.iterations, "mutates_input": outcome.mutated,
        "repeatable": outcome.repeatable}


def _median(values: Any) -> float:
    return float(np.median(values)) if values.size else float("nan")
