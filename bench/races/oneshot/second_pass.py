"""The second pass, after all settings were measured on all problems: more calls of the fastest solvers, warm starts,
and interleaved solves.

Each solver lane has one setting here: the one chosen for 1e-9, else for 1e-6, else its defaults, by first answers
alone. Timed answers are not used for this choice, since each race draws their data anew: two races of the same problems
would then be interleaved at different settings, and could not be compared.

Interleaved solvers are each ready in their own process, all on the same core. In every round each of them does one
update and solve, in a shuffled order, so that it finds the caches as the others left them. Cold and warm solves have
separate rounds. A compensator with other work in its sampling period lies between these figures and the hot ones. A
problem is therefore never divided between workers.
"""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from bench.derived.measurements import FLOOR, HOT, INTERLEAVED, ONESHOT, at_tiers, newest
from bench.derived.tiers import supported, tier_settings
from bench.messages.task import Outcome, Row, Status, Task, Tier
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm
from bench.processes.solver_child import SolverChild, SolverPool
from bench.races.driver import Tell
from bench.races.oneshot.first_pass import FirstPass, Pass
from bench.races.oneshot.measuring import run_block, set_up, with_calls
from bench.races.oneshot.settings import OneshotSettings
from bench.store import Run
from bench.timing.clock import Effort
from solvers import Lane
from solvers.registry import FAMILIES, Described

LONGEST_US = 1000.0
"""Longest hot answer of an interleaved solver on any problem: caches hardly affect longer ones."""
PREFERRED = (Tier.HIGH, Tier.MID)
NEAR = 2.0
"""Largest ratio of a candidate's time to that of the fastest of its lane."""
CANDIDATE_CALLS = 3_000
"""Calls of a candidate over all problems, enough for p99.9."""
WARM_UP = 1
"""Number of untimed rounds."""
PLAN = ["scaling", "solver", "lane"]


@dataclass(frozen=True)
class SecondPass(Pass):
    """One setting of each solver lane."""

    calls: int
    """Number of calls of the tasks that are measured longer."""

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> list[Row]:
        """Measure candidates longer, then warm starts, then interleaved solves."""
        for task in self.tasks:
            tell(task)
            if task.timed != INTERLEAVED and not run.is_done(task):
                calls = self.calls if task.timed == "long" else self.settings.effort.most
                effort = Effort(1.0, 1, calls) if task.timed == "long" else self.settings.effort
                self.measure(run, pool, task, FreshData(self.form, calls), effort)
        together = [task for task in self.tasks if task.timed == INTERLEAVED]
        for start in ("cold", "warm"):
            self._interleave(run, pool, [task for task in together if task.start == start])
        return [run.task(task)[0][0] for task in self.tasks]

    def _interleave(self, run: Run, pool: SolverPool, tasks: Sequence[Task]) -> None:
        """Interleave the tasks, and save those that are not done."""
        if all(run.is_done(task) for task in tasks):
            return
        fresh, seed = FreshData(self.form, self.settings.rounds), f"{self.settings.seed} {self.name}"
        for task, outcome in interleave(tasks, pool.children, self.form, fresh, seed):
            if not run.is_done(task):
                self.save(run, task, outcome, fresh)


def interleave(
    tasks: Sequence[Task],
    children: Mapping[tuple[str, Lane], SolverChild],
    form: CertifiedForm,
    fresh: FreshData,
    seed: str,
    calls: int = 1,
) -> list[tuple[Task, Outcome]]:
    """The interleaved solves of each task.

    Parameters
    ----------
    tasks : sequence of Task
        All on one problem in one scaling, one for each solver lane, whose process keeps one solver ready.
    children : mapping
        Processes by name and lane.
    form : CertifiedForm
        The problem of the set-up.
    fresh : FreshData
        Data of the rounds.
    seed : str
        Determines the order in each round.
    calls : int
        Number of calls in a round.
    """
    chance = random.Random(seed)
    outcomes = {task.key: set_up(children[task.solver, task.lane], task, form) for task in tasks}
    ready = [task for task in tasks if not outcomes[task.key].failure]
    blocks: dict[str, list[Outcome]] = {task.key: [] for task in ready}
    for at in range(-WARM_UP * calls, fresh.count, calls):
        chance.shuffle(ready)
        data = fresh.unseen(calls) if at < 0 else fresh.block(at, at + calls)
        for task in list(ready):
            block = run_block(children[task.solver, task.lane], task, *data)
            if block.failure:
                ready.remove(task)
                outcomes[task.key] = block
            elif at >= 0:
                blocks[task.key].append(block)
    idle_ns = sum(block.cpu_ns for task in ready if task.solver == FLOOR for block in blocks[task.key]) or math.inf
    outcomes |= {task.key: with_calls(outcomes[task.key], blocks[task.key], lambda: idle_ns) for task in ready}
    return [(task, outcomes[task.key]) for task in tasks]


def second_pass(
    run: Run, settings: OneshotSettings, field: Sequence[Described], first: Sequence[FirstPass]
) -> Iterator[SecondPass]:
    """The parts of the second pass, planned from the cold hot rows, all of which are there.

    A solver that is added to a finished run is not interleaved, since among others it meets other caches.
    """
    rows, session = pd.DataFrame(run.rows_so_far()), run.session
    if session:
        rows = pd.concat([newest(run.rows(ONESHOT)), rows], ignore_index=True)
    rows = rows[(rows.timed == HOT) & (rows.start == "cold")]
    calls = math.ceil(CANDIDATE_CALLS / max(1, len({part.problem.name for part in first}) * settings.repeats))
    answered = rows[(rows.session == session) & ((rows.status == Status.OK) | (rows.solver == FLOOR))]
    lines = newest(answered, run.sessions).merge(planned(rows, calls), on=[*PLAN, "setting"])
    plan = {(line["task"], line["repeat"]): line for line in lines.to_dict("records")}
    warm_startable = {(solver.name, solver.lane) for solver in field if solver.warm_start}
    for part in first:
        more: list[Task] = []
        for task in part.tasks:
            line = plan.get((task.subject, task.repeat))
            if line is None:
                continue
            starts = [task]
            if "warm" in part.form.starts and (task.solver, task.lane) in warm_startable:
                starts.append(replace(task, start="warm"))
            more += [replace(task, timed="long")] if line["longer"] else []
            more += starts[1:]
            if line["interleaved"] and settings.rounds and not session:
                more += [replace(each, timed="interleaved") for each in starts]
        yield SecondPass(
            part.run,
            f"{part.name}--second",
            tuple(more),
            part.repeat,
            settings,
            part.problem,
            part.scaling,
            part.judged,
            calls,
        )


def planned(rows: pd.DataFrame, calls: int) -> pd.DataFrame:
    """One row per PLAN with the ``setting`` of the second pass: that of the first of PREFERRED that first answers
    reach, else the default.

    The null solver and those near the fastest of their lane are measured ``longer`` if they have fewer than ``calls``
    somewhere. Those that answer everywhere, and nowhere in more than LONGEST_US, are ``interleaved``.
    """
    rows = rows.assign(timed_gap=math.nan)
    tiers = tier_settings(rows)
    candidates = near_fastest(at_tiers(rows, tiers))
    reached = [tiers[(tiers.tier == tier) & (tiers.setting != "")] for tier in PREFERRED]
    plan = pd.concat([*reached, rows[rows.is_default]])[[*PLAN, "setting"]].drop_duplicates(PLAN)
    here = supported(rows).merge(plan, on=[*PLAN, "setting"])
    here = here.assign(answered=(here.status == Status.OK) | (here.solver == FLOOR))
    lanes = (
        here.groupby([*PLAN, "setting"])
        .agg(answered=("answered", "all"), slowest=("answer_us", "max"), samples=("samples", "min"))
        .reset_index()
    )
    near = pd.MultiIndex.from_frame(lanes[PLAN]).isin(candidates) | (lanes.solver == FLOOR)
    return lanes.assign(
        longer=near & (lanes.samples < calls), interleaved=lanes.answered & (lanes.slowest <= LONGEST_US)
    )


def near_fastest(rows: pd.DataFrame) -> list[tuple[str, str, str]]:
    """The solver lanes, wrappers left out, that are near the fastest of their lane at 1e-9."""
    rows = rows[(rows.tier == Tier.HIGH) & ~rows.lane.isin([str(lane) for lane in FAMILIES])]
    us = rows.answer_us.groupby([rows.scaling, rows.solver, rows.lane]).median()
    return [*us.index[us <= NEAR * us.groupby(level=["scaling", "lane"]).transform("min")]]
