"""The second pass, after all settings were measured on all problems: starts from the optimum before, more calls of the
fastest, and turns.

Each solver lane has one setting here: that which stands for 1e-9, else for 1e-6, else its defaults, by first
answers alone. Timed answers are to data that each race draws anew, and with them two races of the same problems would
take turns at different settings, which cannot be compared. The run notes the settings when the pass begins, since it
measures some of the rows again from which they follow, and a resumed race has to go on as it began.

Where solvers take turns, each sits ready in its own process, all on the same core, and has one update and solve a
round, in a shuffled order; between two turns of one solver all others have had theirs, so that it finds the caches as
they left them. Cold solves have rounds of their own, and so have warm ones. A compensator that has other work in a
sampling period sits between this and the hot figures. So a problem is never divided between workers.
"""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from bench.derived.measurements import at_tiers
from bench.derived.tier_settings import tier_settings
from bench.messages.task import Row, Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm
from bench.processes.solver_child import SolverChild, SolverPool
from bench.races import null_solver
from bench.races.driver import Tell
from bench.races.oneshot.blocks import Timings, ask
from bench.races.oneshot.first_pass import FirstPass, Pass
from bench.races.oneshot.rows import answer_us, median, number
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.worker import OneShot
from bench.store import Planned, Run
from bench.timing.clock import Effort
from bench.timing.percentiles import percentile
from solvers import Lane, Status, Tier
from solvers.registry import FAMILIES, Described

LONGEST_US = 1000.0
"""Whatever takes longer hot has no turn: caches do not matter there, and time does."""
PREFERRED = (Tier.HIGH, Tier.MID)
NEAR = 2.0
"""Largest ratio of a candidate's time to that of the fastest of its lane."""
ENOUGH = 3_000
"""Calls of a candidate over all problems, enough for p99.9."""
WARM_UP = 1
"""Calls before the first turn, of a solver that has been hot."""

SolverKey = tuple[str, str, str]
"""Scaling, solver and lane."""


@dataclass(frozen=True)
class SecondPass(Pass):
    """One setting of each solver lane; the tasks are those that are measured longer and those that start warm."""

    turns: tuple[Task, ...]
    """All that take turns, cold and warm."""
    calls: int
    """Of those that are measured longer."""

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> list[Row]:
        """More calls of some, warm starts, and turns."""
        effort = self.settings.effort
        for task in self.tasks:
            tell(task)
            if task.start == "cold":
                if run.task(task)[0][0]["samples"] < self.calls:
                    fresh = FreshData(self.form, self.calls)
                    self.measure(run, pool, task, fresh, Effort(1.0, 1, self.calls), look_closer=False)
            elif not run.is_done(task):
                self.measure(run, pool, task, FreshData(self.form, effort.most), effort, look_closer=True)
        for start in ("cold", "warm") if self.settings.rounds else ():
            self._take_turns(run, pool, [task for task in self.turns if task.start == start])
        return [run.task(task)[0][0] for task in self.tasks]

    def _take_turns(self, run: Run, pool: SolverPool, tasks: Sequence[Task]) -> None:
        """Rounds of those that are quick, whose figures are added to the tasks on disk."""
        kept = {task.key: run.task(task) for task in tasks}
        quick = [task for task in tasks if answer_us(kept[task.key][0][0]) <= LONGEST_US]
        fresh, seed = FreshData(self.form, self.settings.effort.most), f"{self.settings.seed} {self.name}"
        for task, timings in take_turns(quick, pool.children, self.form, fresh, self.settings.rounds, seed):
            (row,), times = kept[task.key]
            solves = np.concatenate(timings.solves)
            figures = {
                "interleaved_us_p50": median(solves / 1e3),
                "interleaved_us_p99": number(percentile(solves / 1e3, 0.99).value),
            }
            turns = {"interleaved_update": np.concatenate(timings.updates), "interleaved_solve": solves}
            run.save(task, [row | figures], {**times, **turns})


def take_turns(
    tasks: Sequence[Task],
    children: Mapping[tuple[str, Lane], SolverChild],
    form: CertifiedForm,
    fresh: FreshData,
    rounds: int,
    seed: str,
) -> list[tuple[Task, Timings]]:
    """Times and answers of the turns of each task; a task that fails on the way has none.

    Parameters
    ----------
    tasks : sequence of Task
        All on one problem in one scaling, one of each solver lane, whose process has one solver ready.
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
    timings = {task.key: Timings() for task in tasks}
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
        ready = [
            task
            for task in ready
            if not timings[task.key].take(ask(children[task.solver, task.lane], task, *data)).failure
        ]
    return [(task, timings[task.key]) for task in tasks if task in ready]


def second_pass(
    run: Run, settings: OneshotSettings, field: Sequence[Described], first: Sequence[FirstPass]
) -> list[SecondPass]:
    """The second pass over every problem, by what the first has found."""
    if "second_pass" not in run.settings:
        rows = pd.DataFrame(run.rows_so_far())
        run.note(second_pass=planned(rows[rows.solver != null_solver.ENTRY.name]))
    plan = {
        (each["scaling"], each["solver"], each["lane"], each["setting"]): each["longer"]
        for each in run.settings["second_pass"]
    }
    calls = math.ceil(ENOUGH / max(1, len({part.problem.name for part in first}) * settings.repeats))
    warm_startable = {(solver.name, solver.lane) for solver in field if solver.warm_start}
    found = []
    for part in first:
        floor, *tasks = part.tasks
        chosen = [
            (task, plan[key])
            for task in tasks
            if (key := (part.scaling, task.solver, str(task.lane), task.setting.text)) in plan
            and run.task(task)[0][0]["status"] == Status.OK
        ]
        warm = [
            replace(task, start="warm")
            for task, _ in chosen
            if part.form.warm_start is not None and (task.solver, task.lane) in warm_startable
        ]
        found.append(
            SecondPass(
                part.run,
                f"{part.name}--turns",
                (floor, *(task for task, longer in chosen if longer), *warm),
                part.repeat,
                settings,
                part.problem,
                part.scaling,
                (floor, *(task for task, _ in chosen), *warm),
                calls,
            )
        )
    return found


def planned(rows: pd.DataFrame) -> list[Planned]:
    """The setting of each solver lane in each scaling: that of the first of PREFERRED that its first answers reach,
    else the default."""
    rows = rows.assign(timed_gap=math.nan)
    tiers = tier_settings(rows)
    near = near_fastest(at_tiers(rows, tiers))
    reached = [tiers[(tiers.tier == tier) & (tiers.setting != "")] for tier in PREFERRED]
    found: dict[SolverKey, str] = {}
    for part in (*reached, rows[rows.is_default]):
        for line in part.to_dict("records"):
            found.setdefault((line["scaling"], line["solver"], line["lane"]), line["setting"])
    return [
        {"scaling": key[0], "solver": key[1], "lane": key[2], "setting": setting, "longer": key in near}
        for key, setting in found.items()
    ]


def near_fastest(rows: pd.DataFrame) -> set[SolverKey]:
    """The solver lanes between which a decision may have to be made, wrappers left out."""
    rows = rows[(rows.tier == Tier.HIGH) & ~rows.lane.isin([str(lane) for lane in FAMILIES])]
    us = (rows.update_us + rows.solve_us_p50).groupby([rows.scaling, rows.solver, rows.lane]).median()
    best = us.groupby(level=["scaling", "lane"]).transform("min")
    return set(us.index[us <= NEAR * best])
