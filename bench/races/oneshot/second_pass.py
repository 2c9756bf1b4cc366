"""The second pass, after all settings were measured on all problems: warm starts, more calls of the fastest solvers,
and interleaved solves.

Each solver lane has one setting here: the one chosen for 1e-9, else for 1e-6, else its defaults, by first answers
alone. Timed answers are not used for this choice, since each race draws their data anew: two races of the same problems
would then be interleaved at different settings, and could not be compared. The run notes the settings when the pass
begins, because the pass replaces some of the rows from which they follow, and a resumed race must not change them.

Interleaved solvers are each ready in their own process, all on the same core. In every round each of them does one
update and solve, in a shuffled order, so that it finds the caches as the others left them. Cold and warm solves have
separate rounds. A compensator with other work in its sampling period lies between these figures and the hot ones. A
problem is therefore never divided between workers.
"""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from bench.derived.measurements import at_tiers
from bench.derived.tier_settings import tier_settings
from bench.messages.task import Row, Task
from bench.messages.verdict import Status, Tier
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm
from bench.processes.solver_child import SolverChild, SolverPool
from bench.races import null_solver
from bench.races.driver import Tell
from bench.races.oneshot.blocks import BlockError, joined, run_block, set_up
from bench.races.oneshot.first_pass import FirstPass, Pass
from bench.races.oneshot.rows import answer_us, median, number
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.worker import BlockOutcome
from bench.store import Planned, Run
from bench.timing.clock import Effort
from bench.timing.percentiles import percentile
from solvers import Lane
from solvers.registry import FAMILIES, Described

LONGEST_US = 1000.0
"""Longest hot answer of an interleaved solver: caches hardly affect longer ones."""
PREFERRED = (Tier.HIGH, Tier.MID)
NEAR = 2.0
"""Largest ratio of a candidate's time to that of the fastest of its lane."""
CANDIDATE_CALLS = 3_000
"""Calls of a candidate over all problems, enough for p99.9."""
WARM_UP = 1
"""Number of untimed rounds."""

SolverKey = tuple[str, str, str]
"""Scaling, solver and lane."""


@dataclass(frozen=True)
class SecondPass(Pass):
    """One setting of each solver lane; the tasks are those that are measured longer and those that start warm."""

    interleaved: tuple[Task, ...]
    """Cold and warm tasks."""
    calls: int
    """Number of calls of the tasks that are measured longer."""

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> list[Row]:
        """Measure candidates longer, then warm starts, then interleaved solves."""
        effort = self.settings.effort
        for task in self.tasks:
            tell(task)
            if task.start == "cold":
                if run.task(task)[0][0]["samples"] < self.calls:
                    fresh = FreshData(self.form, self.calls)
                    self.measure(run, pool, task, fresh, Effort(1.0, 1, self.calls), test_for_cheating=False)
            elif not run.is_done(task):
                self.measure(run, pool, task, FreshData(self.form, effort.most), effort, test_for_cheating=True)
        for start in ("cold", "warm") if self.settings.rounds else ():
            self._interleave(run, pool, [task for task in self.interleaved if task.start == start])
        return [run.task(task)[0][0] for task in self.tasks]

    def _interleave(self, run: Run, pool: SolverPool, tasks: Sequence[Task]) -> None:
        """Interleave the quick ones of the tasks, and add the figures to their rows."""
        saved = {task.key: run.task(task) for task in tasks}
        quick = [task for task in tasks if answer_us(saved[task.key][0][0]) <= LONGEST_US]
        fresh, seed = FreshData(self.form, self.settings.effort.most), f"{self.settings.seed} {self.name}"
        for task, calls in interleave(quick, pool.children, self.form, fresh, self.settings.rounds, seed):
            (row,), times = saved[task.key]
            solve_us = calls.solve_ns / 1e3
            figures = {
                "interleaved_us_p50": median(solve_us),
                "interleaved_us_p99": number(percentile(solve_us, 0.99).value),
            }
            raw = {"interleaved_update": calls.update_ns, "interleaved_solve": calls.solve_ns}
            run.save(task, [row | figures], {**times, **raw})


def interleave(
    tasks: Sequence[Task],
    children: Mapping[tuple[str, Lane], SolverChild],
    form: CertifiedForm,
    fresh: FreshData,
    rounds: int,
    seed: str,
) -> list[tuple[Task, BlockOutcome]]:
    """Times and answers of the interleaved solves of each task; tasks that fail are left out.

    Parameters
    ----------
    tasks : sequence of Task
        All on one problem in one scaling, one for each solver lane, whose process keeps one solver ready.
    children : mapping
        Processes by name and lane.
    form : CertifiedForm
        The problem of the set-up.
    fresh : FreshData
        Data of the rounds, one call each.
    rounds : int
    seed : str
        Determines the order in each round.
    """
    chance = random.Random(seed)
    ready = [task for task in tasks if not set_up(children[task.solver, task.lane], task, form).failure]
    blocks: dict[str, list[BlockOutcome]] = {task.key: [] for task in ready}
    for at in range(-WARM_UP, rounds):
        chance.shuffle(ready)
        data = fresh.unseen(1)
        for task in list(ready):
            try:
                block = run_block(children[task.solver, task.lane], task, *data)
            except BlockError:
                ready.remove(task)
            else:
                blocks[task.key] += [block] if at >= 0 else []
    return [(task, joined(blocks[task.key])) for task in tasks if task in ready]


def second_pass(
    run: Run, settings: OneshotSettings, field: Sequence[Described], first: Sequence[FirstPass]
) -> list[SecondPass]:
    """The parts of the second pass, by the rows of the first."""
    if "second_pass" not in run.settings:
        rows = pd.DataFrame(run.rows_so_far())
        run.note(second_pass=planned(rows[rows.solver != null_solver.ENTRY.name]))
    longer = {
        (plan["scaling"], plan["solver"], plan["lane"], plan["setting"]): plan["longer"]
        for plan in run.settings["second_pass"]
    }
    calls = math.ceil(CANDIDATE_CALLS / max(1, len({part.problem.name for part in first}) * settings.repeats))
    warm_startable = {(solver.name, solver.lane) for solver in field if solver.warm_start}
    parts = []
    for part in first:
        floor, *tasks = part.tasks
        cold, longer_cold, warm = [floor], [floor], []
        for task in tasks:
            key = (part.scaling, task.solver, str(task.lane), task.setting.text)
            if key not in longer or run.task(task)[0][0]["status"] != Status.OK:
                continue
            cold.append(task)
            if longer[key]:
                longer_cold.append(task)
            if part.form.warm_start is not None and (task.solver, task.lane) in warm_startable:
                warm.append(replace(task, start="warm"))
        parts.append(
            SecondPass(
                part.run,
                f"{part.name}--turns",
                (*longer_cold, *warm),
                part.repeat,
                settings,
                part.problem,
                part.scaling,
                (*cold, *warm),
                calls,
            )
        )
    return parts


def planned(rows: pd.DataFrame) -> list[Planned]:
    """The setting of each solver lane in each scaling: the one chosen for the first of PREFERRED that its first answers
    reach, else the default."""
    rows = rows.assign(timed_gap=math.nan)
    tiers = tier_settings(rows)
    candidates = near_fastest(at_tiers(rows, tiers))
    reached = [tiers[(tiers.tier == tier) & (tiers.setting != "")] for tier in PREFERRED]
    settings: dict[SolverKey, str] = {}
    for table in (*reached, rows[rows.is_default]):
        for line in table.to_dict("records"):
            settings.setdefault((line["scaling"], line["solver"], line["lane"]), line["setting"])
    return [
        {"scaling": key[0], "solver": key[1], "lane": key[2], "setting": setting, "longer": key in candidates}
        for key, setting in settings.items()
    ]


def near_fastest(rows: pd.DataFrame) -> set[SolverKey]:
    """The solver lanes, wrappers left out, that are near the fastest of their lane at 1e-9."""
    rows = rows[(rows.tier == Tier.HIGH) & ~rows.lane.isin([str(lane) for lane in FAMILIES])]
    us = (rows.update_us + rows.solve_us_p50).groupby([rows.scaling, rows.solver, rows.lane]).median()
    best = us.groupby(level=["scaling", "lane"]).transform("min")
    return set(us.index[us <= NEAR * best])
