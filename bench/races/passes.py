"""The two passes over the problems, each divided by problem, scaling and repeat.

In the first pass every setting of every solver is timed hot. The settings of a solver lane follow each other from loose
to tight; after a crash, a timeout or an answer that takes longer than a tenth of the time limit, tighter settings are
skipped on this problem. That is far from what an answer takes here, so that accuracy does not depend on the clock.

The second pass, after all settings were measured on all problems, has more calls of the fastest solvers, warm starts,
and interleaved solves. Each solver lane has one setting here: the one chosen for 1e-9, else for 1e-6, else its
defaults, by first answers alone. Timed answers are not used for this choice, since each race draws their data anew: two
races of the same problems would then be interleaved at different settings, and could not be compared.

*Scheduled* calls, if requested, follow the clock of `bench.timing.schedule`: each sample brings data of its own.

Interleaved solvers are each ready in their own process, all on the same core. In every round each of them does one
update and solve, in a shuffled order, so that it finds the caches as the others left them. Cold and warm solves have
separate rounds. A compensator with other work in its sampling period lies between these figures and the hot ones. A
problem is therefore never divided between workers.
"""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Self

import pandas as pd

from bench.derived.measurements import HOT, INTERLEAVED, NULL_SOLVER, SCHEDULED, at_tiers
from bench.derived.tiers import supported, tier_settings
from bench.messages.task import Outcome, Row, Start, Status, Task, Tier, Timed
from bench.part_file import PartFile
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.sentinel import EVERY_S, Sentinel
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.lanes import described_by
from bench.races.measuring import interleave, row_of, scheduled, timed
from bench.races.settings import RaceSettings
from bench.store import Run
from bench.timing import machine
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from solvers.registry import FAMILIES, Described

LONGEST_INTERLEAVED_US = 1000.0
"""Longest hot answer of an interleaved solver on any problem: caches hardly affect longer ones."""
PREFERRED = (Tier.HIGH, Tier.MID)
NEAR = 2.0
"""Largest ratio of a candidate's time to that of the fastest of its lane."""
CANDIDATE_CALLS = 3_000
"""Calls of a candidate over all problems, enough for p99.9."""
ENOUGH_JUDGED = 100
"""Calls of a candidate on a problem, all of which are judged."""
PLAN = ["scaling", "solver", "lane"]


@dataclass(frozen=True)
class Part:
    """One problem in one scaling and one repeat, which one worker does in one go, on any host that can access the run's
    folder.

    The tasks of a solver lane follow each other; the null solver comes first.
    """

    run: Path
    name: str
    """Name of its file, without the suffix."""
    tasks: tuple[Task, ...]
    repeat: int
    """Number of the repeat; each has fresh processes."""
    settings: RaceSettings
    problem: RaceProblem
    scaling: Scaling
    proven: int
    """Most timed answers of each task that are judged in exact arithmetic."""
    calls: int = 0
    """Number of calls of the tasks that are measured longer."""

    @property
    def form(self) -> CertifiedForm:
        """The problem in this scaling."""
        return self.problem.forms[self.scaling]

    def do(self, pool: SolverPool) -> Self:
        """Do the tasks that are not done yet, monitor the machine, and save notes at the end; returns the part."""
        run = Run(self.run)
        part = run.part(self.name)
        if part.notes is not None:
            return self
        pool.begin(self.repeat)
        described_by(run, pool)
        sentinel = Sentinel(pool.children[null_solver.ENTRY.name, null_solver.ENTRY.lane])
        with part.appended():
            sentinel.sample()
            before = machine.counters()
            self._work(part, run.note_machine(), pool, sentinel)
            between = machine.between(before, machine.counters())
            sentinel.sample()
            part.finish(
                {
                    "host": os.uname().nodename,
                    "core": pool.core,
                    "sentinel": sentinel.samples,
                    **between,
                    "preemptions": sum(row["preemptions"] for row in part.rows.values()),
                    "timed_calls": sum(row["samples"] for row in part.rows.values()),
                }
            )
        return self

    def _work(self, part: PartFile, here: str, pool: SolverPool, sentinel: Sentinel) -> None:
        """Measure one ladder after the other, then interleave the tasks that are; ``here`` is this machine."""

        def save(task: Task, outcome: Outcome, fresh: FreshData | None = None) -> None:
            """Judge an outcome, and save its row and its raw times."""
            part.save(row_of(self.problem, task, outcome, fresh, self.proven, here), outcome.times)

        @cache
        def fresh(place: int, timing: Timed, start: Start, own: Path | None) -> FreshData:
            """Data of a task, other for each setting of a solver and each file of a user's ``own``, so that answers
            kept from another are of no use."""
            return FreshData(self.form, self.settings.schedule if timing == SCHEDULED else self._effort(timing).most)

        for (solver, lane, timing, start), ladder in groupby(
            self.tasks, lambda task: (task.solver, task.lane, task.timed, task.start)
        ):
            if timing != INTERLEAVED:
                self._ladder(
                    part,
                    save,
                    pool,
                    sentinel,
                    [
                        (task, fresh(i, timing, start, pool.children[solver, lane].entry.path))
                        for i, task in enumerate(ladder)
                    ],
                )
        for start in ("cold", "warm"):
            tasks = [task for task in self.tasks if (task.timed, task.start) == (INTERLEAVED, start)]
            if any(task.key not in part.rows for task in tasks):
                drawn, seed = FreshData(self.form, self.settings.rounds), f"{self.settings.seed} {self.name}"
                for task, outcome in interleave(tasks, pool.children, self.form, drawn, seed):
                    if task.key not in part.rows:
                        save(task, outcome, drawn)

    def _effort(self, timing: Timed) -> Effort:
        return Effort(1.0, 1, self.calls) if timing == "long" else self.settings.effort

    def _ladder(
        self,
        part: PartFile,
        save: Callable[..., None],
        pool: SolverPool,
        sentinel: Sentinel,
        tasks: Sequence[tuple[Task, FreshData]],
    ) -> None:
        """Measure the settings of one solver lane."""
        end = ""
        for task, fresh in tasks:
            if task.key not in part.rows and end:
                save(task, Outcome(str(Status.NOT_RUN), f"a looser setting {end} on this problem"))
            elif task.key not in part.rows:
                null = pool.children[null_solver.ENTRY.name, null_solver.ENTRY.lane]
                outcome = (
                    scheduled(pool.children[task.solver, task.lane], task, self.form, fresh)
                    if task.timed == SCHEDULED
                    else timed(
                        pool.children[task.solver, task.lane], null, task, self.form, fresh, self._effort(task.timed)
                    )
                )
                save(task, outcome, fresh)
                sentinel.sample(unless_within_s=EVERY_S)
            if task.setting.rung >= 0:
                end = end or self._end_of_ladder(part.rows[task.key])

    def _end_of_ladder(self, row: Row) -> str:
        """Why tighter settings than that of a row are skipped on this problem, or ""."""
        if row["status"] in (Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY):
            return f"ended with {row['status']}"
        longest_s = self.settings.longest_s
        return f"took longer than {longest_s:g} s" if row["answer_us"] > 1e6 * longest_s else ""


def second_pass(run: Run, settings: RaceSettings, lanes: Sequence[Described], first: Sequence[Part]) -> Iterator[Part]:
    """The parts of the second pass, planned from the cold hot rows, all of which are there."""
    rows = run.rows_so_far()
    rows = rows[(rows.timed == HOT) & (rows.start == "cold")]
    tasks = max(1, len({part.problem.name for part in first}) * settings.repeats)
    calls = max(ENOUGH_JUDGED, math.ceil(CANDIDATE_CALLS / tasks))
    answered = rows[(rows.status == Status.ANSWERED) | (rows.solver == NULL_SOLVER)]
    lines = answered.merge(planned(rows, calls), on=[*PLAN, "setting"])
    plan = {(line["task"], line["repeat"]): line for line in lines.to_dict("records")}
    warm_startable = {(solver.name, solver.lane) for solver in lanes if solver.warm_start}
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
            if line["interleaved"] and settings.rounds:
                more += [replace(start, timed="interleaved") for start in starts]
            if line["interleaved"] and settings.schedule:
                more.append(replace(task, timed="scheduled"))
        yield replace(part, name=f"{part.name}--second", tasks=tuple(more), calls=calls)


def planned(rows: pd.DataFrame, calls: int) -> pd.DataFrame:
    """One row per PLAN with the ``setting`` of the second pass: that of the first of PREFERRED that first answers
    reach, else the default.

    The null solver and those near the fastest of their lane are measured ``longer`` if they have fewer than ``calls``
    somewhere. Those that answer everywhere, and nowhere in more than LONGEST_INTERLEAVED_US, are ``interleaved``.
    """
    rows = rows.assign(timed_gap=math.nan)
    tiers = tier_settings(rows)
    candidates = near_fastest(at_tiers(rows, tiers))
    reached = [tiers[(tiers.tier == tier) & (tiers.setting != "")] for tier in PREFERRED]
    plan = pd.concat([*reached, rows[rows.is_default]])[[*PLAN, "setting"]].drop_duplicates(PLAN)
    here = supported(rows).merge(plan, on=[*PLAN, "setting"])
    here = here.assign(answered=(here.status == Status.ANSWERED) | (here.solver == NULL_SOLVER))
    lanes = (
        here.groupby([*PLAN, "setting"])
        .agg(answered=("answered", "all"), slowest=("answer_us", "max"), samples=("samples", "min"))
        .reset_index()
    )
    near = pd.MultiIndex.from_frame(lanes[PLAN]).isin(candidates) | (lanes.solver == NULL_SOLVER)
    return lanes.assign(
        longer=near & (lanes.samples < calls), interleaved=lanes.answered & (lanes.slowest <= LONGEST_INTERLEAVED_US)
    )


def near_fastest(rows: pd.DataFrame) -> list[tuple[str, str, str]]:
    """The solver lanes, wrappers left out, that are near the fastest of their lane at 1e-9."""
    rows = rows[(rows.tier == Tier.HIGH) & ~rows.lane.isin([str(lane) for lane in FAMILIES])]
    us = rows.answer_us.groupby([rows.scaling, rows.solver, rows.lane]).median()
    return [*us.index[us <= NEAR * us.groupby(level=["scaling", "lane"]).transform("min")]]
