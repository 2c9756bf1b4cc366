"""Interleaved rounds: the solvers of one problem take turns, one update and solve each, in a shuffled order.

Each solver sits ready in its own process, all on the same core; the parent says whose turn it is, and between two turns
of one solver all others have had theirs, so that it finds the caches as they left them. A compensator that has other work
in a sampling period sits between this and the hot figures.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence

from bench.passed.task import Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm
from bench.processes.solver_child import SolverChild
from bench.races.oneshot.blocks import Tally, ask
from bench.races.oneshot.worker import OneShot
from solvers import Lane

WARM_UP = 1
"""Calls before the first turn, of a solver that has been hot."""


def take_turns(tasks: Sequence[Task], children: Mapping[tuple[str, Lane], SolverChild], form: CertifiedForm, fresh: FreshData,
               rounds: int, seed: str) -> list[tuple[Task, Tally]]:
    """Times and answers of the turns of each task; a task that fails on the way has none.

    Parameters
    ----------
    tasks : sequence of Task
        All on one problem in one scaling.
    children : mapping
        By name and lane.
    form : CertifiedForm
        What is set up.
    fresh : FreshData
        What is solved, one call a round.
    rounds : int
        Turns of each.
    seed : str
        The order in each round follows from it.
    """
    tallies = {task.key: Tally() for task in tasks}
    ready = []
    for task in tasks:
        child = children[task.solver, task.lane]
        if not child.ask(OneShot.of(task, form, times_itself=child.entry.times_itself)).failure:
            ready.append(task)
    for task in list(ready):
        if ask(children[task.solver, task.lane], task, *fresh.unseen(WARM_UP)).failure:
            ready.remove(task)
    chance = random.Random(seed)
    for _ in range(rounds):
        chance.shuffle(ready)
        data = fresh.unseen(1)
        ready = [task for task in ready if not tallies[task.key].take(ask(children[task.solver, task.lane], task, *data)).failure]
    return [(task, tallies[task.key]) for task in tasks if task in ready]
