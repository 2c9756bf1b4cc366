"""The first pass over a problem: every setting of every solver hot, one after the other, in one scaling and one repeat.

The settings of a solver follow each other from loose to tight, and a crash, a timeout or an answer that takes longer
than 0.1 s ends its ladder on this problem. At one of them, which is drawn here where no solver can know it, is looked
whether the solver answers from memory or works while nobody times it; where that one has no answer, another that has is
measured again for it.
"""

import math
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from bench.messages.task import Outcome, Row, Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.sentinel import EVERY_S
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.driver import Part, Tell
from bench.races.oneshot.blocks import timed
from bench.races.oneshot.rows import answer_us, row_of
from bench.races.oneshot.settings import OneshotSettings
from bench.store import Run
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from solvers import Status

LONGEST_US = 1e5
"""A ladder ends on a problem where an answer takes longer."""


@dataclass(frozen=True)
class Pass(Part):
    """One problem in one scaling and one repeat.

    Tasks of a solver lane follow each other; the solver that does nothing comes first.
    """

    settings: OneshotSettings
    problem: RaceProblem
    scaling: Scaling

    @property
    def form(self) -> CertifiedForm:
        """The problem in this scaling."""
        return self.problem.forms[self.scaling]

    def measure(
        self, run: Run, pool: SolverPool, task: Task, fresh: FreshData, effort: Effort, look_closer: bool
    ) -> Row:
        """Time a task, judge it and keep it."""
        idle = pool.children[null_solver.ENTRY.name, null_solver.ENTRY.lane]
        outcome, timings = timed(pool.child(task), idle, task, self.problem, fresh, effort, look_closer)
        row = row_of(self.problem, task, outcome, max(timings.gaps.values(), default=math.nan), timings.fault)
        run.save(task, [row], {"setup": outcome.setup_ns, "update": outcome.update_ns, "solve": outcome.solve_ns})
        pool.sentinel.sample(unless_within_s=EVERY_S)
        return row


@dataclass(frozen=True)
class FirstPass(Pass):
    """Every setting."""

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> list[Row]:
        """One ladder after the other."""
        ladders = [list(ladder) for _, ladder in groupby(self.tasks, key=lambda task: (task.solver, task.lane))]
        # Each setting of a solver has data of its own: what was kept of the answers at another one is of no use to it.
        fresh = [FreshData(self.form, self.settings.effort.most) for _ in range(max(map(len, ladders)))]
        return [row for ladder in ladders for row in self._ladder(run, fresh, pool, ladder, tell)]

    def _ladder(
        self, run: Run, fresh: Sequence[FreshData], pool: SolverPool, tasks: Sequence[Task], tell: Tell
    ) -> list[Row]:
        """The settings of one solver lane."""
        rows: list[Row] = []
        end, effort = "", self.settings.effort
        left = [task for task in tasks if not run.is_done(task)]
        drawn, looked = secrets.choice(left or tasks), not left
        for task, data in zip(tasks, fresh, strict=False):
            if rows and _is_at_its_limit(tasks[len(rows) - 1], rows[-1]):
                break
            tell(task)
            if run.is_done(task):
                rows += run.task(task)[0]
            elif end and task.setting.rung >= 0:
                why = f"a looser setting {end} on this problem"
                rows.append(row_of(self.problem, task, Outcome(str(Status.NOT_RUN), why)))
                run.save(task, rows[-1:], {})
            else:
                rows.append(self.measure(run, pool, task, data, effort, look_closer=task is drawn))
                looked |= task is drawn and rows[-1]["samples"] > 0
            if task.setting.rung >= 0:
                end = end or _end_of_ladder(rows[-1])
        answered = [i for i, row in enumerate(rows) if row["samples"]]
        if answered and not looked:
            i = secrets.choice(answered)
            unseen = FreshData(self.form, effort.most)
            rows[i] = self.measure(run, pool, tasks[i], unseen, effort, look_closer=True)
        return rows


def _end_of_ladder(row: Row) -> str:
    """Why settings tighter than that of a row are not tried on this problem, or nothing."""
    if row["status"] in (Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY):
        return f"ended with {row['status']}"
    return "took longer than 0.1 s" if answer_us(row) > LONGEST_US else ""


def _is_at_its_limit(task: Task, row: Row) -> bool:
    """Whether larger limits of iterations than that of a task change nothing, or take too long."""
    limit = max(task.more.values(), default=math.inf)
    return bool(task.setting.rung_text and (0 <= row["iterations"] < limit or answer_us(row) > LONGEST_US))
