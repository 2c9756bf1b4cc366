"""The anytime race: how exact an answer is that has to be there after so many sampling periods.

Every solver that has a limit of iterations runs with growing limits, from a cold start each time, and gives points
(time, exact cost gap); the others give the one point of their full solve. Time is the median of update plus the median of
solve, in sampling periods of 125 µs. The accuracy *within* a budget is the best of the points that are there by then. The limits grow
until the solver is done before it meets one, the iterate stays the same to the last bit, or the next limit would by the growth of
the last ones take longer than ``longest_s``.

The paper's method stands there twice: with as many steps as fit into the time, and with one step a sample as the paper
runs it beside the machine, where a step takes a period whatever it costs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from bench.passed.outcome import Outcome
from bench.passed.progress import Progress
from bench.passed.row import Row, who
from bench.passed.task import Task, tightest
from bench.problem_files.program import fields_of
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.engine import Workers
from bench.processes.line_up import LineUp
from bench.processes.sentinel import EVERY_S
from bench.processes.solver_child import SolverChild
from bench.races.anytime.worker import Point, PointRequest
from bench.races.conditions import note_conditions, watched
from bench.races.field import checked, field_of
from bench.races.metrics import relative_gap
from bench.races.run_problems import keep_proofs, problems_of
from bench.races.settings import RaceSettings, settings_of
from bench.store import Run, Schema
from bench.timing import cores
from bench.timing.clock import Effort
from bench.timing.schedule import PERIOD_US
from piezo_model.identification_problem import Scaling
from solvers import Status
from solvers.registry import Described

NAN = float("nan")

BUDGETS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 15_200)
"""Sampling periods; the last are the paper's 1.9 s."""
LIMITS = (*BUDGETS, *(step * 10**power for power in range(4, 8) for step in (2, 5, 10)))
"""Iterations."""

ANYTIME = Schema("anytime.parquet", (
    "problem_set", "problem", "d", "solver", "lane", "setting", "rung", "scaling", "settings", "repeat", "status", "message",
    "limit", "iteration_setting", "found", "iterations", "cost_gap", "violation", "update_us", "solve_us_p50", "samples",
    "periods"),
    ("problem_set", "problem", "scaling", "solver", "lane", "limit", "repeat"))
"""One row a point; ``limit`` is −1 where the solver has none."""


@dataclass(frozen=True)
class AnytimeSettings(RaceSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    effort: Effort = field(default_factory=lambda: Effort(budget_s=0.01, fewest=1))
    longest_s: float = BUDGETS[-1] * PERIOD_US * 1e-6
    """No limit that would take longer is tried."""


def race(run: Run, progress: Progress, workers: Workers) -> None:
    """Do whatever is not done yet."""
    settings = settings_of(run, AnytimeSettings)
    chosen = checked(settings)
    problems = list(problems_of(run, settings, progress))
    progress("waiting for a core on which no other race times", 0, 1)
    with cores.claim() as core, LineUp(chosen, settings.limits, core.number) as line_up:
        field = field_of(run, line_up.children.values())
        _race(run, settings, field, line_up, problems, progress)
    keep_proofs(run, problems)
    note_conditions(run, workers)


def tasks_of(field: Sequence[Described], problem: RaceProblem, scaling: Scaling, repeat: int = 0) -> Iterator[Task]:
    """One task a curve, at the tightest setting, so that it is the limit of iterations that ends a solve."""
    for solver in field:
        yield Task(problem.set_name, problem.name, scaling, solver.name, solver.lane, tightest(solver), repeat=repeat)


@dataclass
class Curve(Outcome):
    """The points of a task by growing limit, and the name of the setting, "" where the solver has none."""

    points: list[Point] = field(default_factory=list)
    iteration_setting: str = ""


def curve_of(ask: Callable[[int], Outcome], limits: Sequence[int], longest_s: float) -> Outcome:
    """Ask for the point of each limit, ascending; the outcome of the first that fails."""
    points: list[Point] = []
    for limit in limits:
        if points:
            last = points[-1]
            seconds = 1e-9 * float(np.median(last.update_ns) + np.median(last.solve_ns))
            if seconds * limit / last.limit > longest_s:
                break
        point = ask(limit)
        if not isinstance(point, Point):
            return point
        points.append(point)
        done = not point.iteration_setting or (point.found and point.iterations != limit)
        if done or (len(points) > 1 and np.array_equal(point.x, points[-2].x)):
            break
    return Curve(found=True, points=points, asked=points[0].asked, iteration_setting=points[0].iteration_setting)


def point_of(child: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, effort: Effort, limit: int) -> Outcome:
    """The point of one limit, timed on data that nobody has seen."""
    P, q = fresh.unseen(min(effort.most, fresh.calls_at_once))
    return child.ask(PointRequest(task, fields_of(form.qp), form.unit, effort, limit, P, q, child.entry.times_itself))


def _race(run: Run, settings: AnytimeSettings, field: Sequence[Described], line_up: LineUp, problems: Sequence[RaceProblem],
          progress: Progress) -> None:
    """Do the tasks that are not done."""
    parts = [(repeat, problem, scaling, list(tasks_of(field, problem, scaling, repeat)))
             for repeat in range(settings.repeats) for problem in problems for scaling in settings.scalings]
    done, total = 0, sum(len(tasks) for *_, tasks in parts)
    for repeat, problem, scaling, tasks in parts:
        line_up.begin(repeat)
        form = problem.forms[scaling]
        fresh = FreshData(form, 1)
        with watched(run, f"{problem.set_name}--{problem.name}--{scaling}--{repeat}", line_up.sentinel):
            for task in tasks:
                progress(f"{task.solver} ({task.lane}) on {problem.name}, {scaling}", done, total)
                done += 1
                if not run.is_done(task):
                    child = line_up.children[task.solver, task.lane]
                    outcome = curve_of(partial(point_of, child, task, form, fresh, settings.effort), LIMITS, settings.longest_s)
                    run.save(task, rows_of(problem, task, outcome), times_of(outcome))
                    line_up.sentinel.look(unless_within_s=EVERY_S)


def times_of(outcome: Outcome) -> dict[str, Any]:
    """Raw nanoseconds by what was timed, such as "solve 100"."""
    points = outcome.points if isinstance(outcome, Curve) else []
    return {f"{what} {point.limit}": nanoseconds for point in points
            for what, nanoseconds in (("update", point.update_ns), ("solve", point.solve_ns))}


def rows_of(problem: RaceProblem, task: Task, outcome: Outcome) -> list[Row]:
    """One row a point; one in all where there is none."""
    shared = who(task, problem.d, outcome.asked)
    if not isinstance(outcome, Curve):
        return [ANYTIME.row(**shared, status=outcome.failure, message=outcome.message, limit=-1, iterations=-1)]
    return [{**shared, **_figures(problem.forms[task.scaling], point), "iteration_setting": outcome.iteration_setting}
            for point in outcome.points]


def _figures(form: CertifiedForm, point: Point) -> dict[str, Any]:
    """How exact and how fast; the status is ok wherever there is an answer to measure, however inexact."""
    measurable = point.x.shape == form.qp.q.shape and bool(np.isfinite(point.x).all())
    gap, violation = relative_gap(form, point.x) if measurable else (NAN, NAN)
    update, solve = (float(np.median(times)) / 1e3 for times in (point.update_ns, point.solve_ns))
    return {"status": str(Status.OK if measurable else Status.SOLVER_FAILED), "message": "" if measurable else f"no answer: {point.solver_status}",
            "limit": point.limit, "found": point.found, "iterations": point.iterations,
            "cost_gap": gap, "violation": violation, "update_us": update,
            "solve_us_p50": solve, "samples": point.solve_ns.size, "periods": (update + solve) / PERIOD_US}
