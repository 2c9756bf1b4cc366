"""Interleaved rounds: the solvers of one problem take turns, one update and solve each, in a shuffled order.

Each solver sits ready in its own process, all on the same core; the parent says whose turn it is, and between two turns
of one solver all others have had theirs, so that it finds the caches as they left them. A compensator that has other work
in a sampling period sits between this and the hot figures.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence

from qpsolvers import Problem

from bench.passed.outcome import Outcome
from bench.passed.task import Task
from bench.problems.protocol import Vector
from bench.processes.solver_child import SolverChild
from bench.races.oneshot.worker import Collect, Prepare, Turn
from bench.timing.clock import Effort
from solvers import Lane, Tier

LONGEST_US = 3000.0
"""Tasks whose update and solve take longer than this hot have no turn: caches do not matter there, and time does."""
WARM_UP = Effort(0.0, 3, 3)


IN_TURNS = (Tier.HIGH, Tier.EXACT, Tier.MID, Tier.LOW, Tier.DEFAULT)
"""Tiers, the one at which solvers take turns first; the others stand in where a solver is not asked for it."""


def most_exact(tasks: Iterable[Task]) -> list[Task]:
    """Of each solver lane and start the task at the first of the tiers IN_TURNS that it has."""
    found: dict[tuple[str, Lane, str], Task] = {}
    for task in sorted((task for task in tasks if _place(task) < len(IN_TURNS)), key=_place):
        found.setdefault((task.solver, task.lane, task.start), task)
    return list(found.values())


def _place(task: Task) -> int:
    return min((IN_TURNS.index(tier) for tier in task.tiers if tier in IN_TURNS), default=len(IN_TURNS))


def take_turns(tasks: Sequence[Task], children: Mapping[tuple[str, Lane], SolverChild], problem: Problem,
               warm_start: Vector | None, rounds: int, seed: str, c: float = 1.0) -> list[tuple[Task, Outcome]]:
    """Times of the turns of each task; a task that fails on the way has none.

    Parameters
    ----------
    tasks : sequence of Task
        All on one problem in one scaling.
    children : mapping
        By name and lane.
    problem, warm_start, c
        What is solved, where warm tasks start, and the constant that ladders are made for.
    rounds : int
        Turns of each.
    seed : str
        The order in each round follows from it.
    """
    keys = {task.key: children[task.solver, task.lane] for task in tasks}
    asked = {task.key: Prepare.of(task, problem, WARM_UP, warm_start if task.start == "warm" else None, c) for task in tasks}
    ready = [key for key, child in keys.items() if not child.ask(asked[key]).failure]
    turns = {key: Turn(key) for key in ready}
    chance = random.Random(seed)
    for _ in range(rounds):
        chance.shuffle(ready)
        ready = [key for key in ready if not keys[key].ask(turns[key]).failure]
    collected = {key: keys[key].ask(Collect(key)) for key in sorted(ready)} if rounds else {}
    return [(task, collected[task.key]) for task in tasks if task.key in collected and not collected[task.key].failure]
