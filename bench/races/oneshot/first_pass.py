"""The first pass over a problem: every setting of every solver, hot, in one scaling and one repeat.

The settings of a solver follow each other from loose to tight; after a crash, a timeout or an answer that takes longer
than 0.1 s, tighter settings are skipped on this problem.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from bench.messages.task import Outcome, Row, Status, Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.sentinel import EVERY_S
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.driver import Part, Tell
from bench.races.oneshot.measuring import row_of, timed
from bench.races.oneshot.settings import OneshotSettings
from bench.store import Run
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling

LONGEST_US = 1e5
"""Longest answer after which tighter settings are tried."""


@dataclass(frozen=True)
class Pass(Part):
    """One problem in one scaling and one repeat.

    The tasks of a solver lane follow each other; the null solver comes first.
    """

    settings: OneshotSettings
    problem: RaceProblem
    scaling: Scaling
    judged: int
    """Number of timed answers of each task that are judged."""

    @property
    def form(self) -> CertifiedForm:
        """The problem in this scaling."""
        return self.problem.forms[self.scaling]

    def measure(self, run: Run, pool: SolverPool, task: Task, fresh: FreshData, effort: Effort) -> Row:
        """Time, judge and save a task."""
        idle = pool.children[null_solver.ENTRY.name, null_solver.ENTRY.lane]
        row = self.save(run, task, timed(pool.child(task), idle, task, self.form, fresh, effort), fresh)
        pool.sentinel.sample(unless_within_s=EVERY_S)
        return row

    def save(self, run: Run, task: Task, outcome: Outcome, fresh: FreshData | None = None) -> Row:
        """Judge an outcome, and save its row and its raw times."""
        row = row_of(self.problem, task, outcome, fresh, self.judged)
        run.save(task, [row], outcome.times)
        return row


@dataclass(frozen=True)
class FirstPass(Pass):
    """All settings."""

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> list[Row]:
        """Measure one ladder after the other."""
        ladders = [list(ladder) for _, ladder in groupby(self.tasks, key=lambda task: (task.solver, task.lane))]
        # Each setting of a solver has data of its own, so that answers kept from another setting are of no use.
        fresh = [FreshData(self.form, self.settings.effort.most) for _ in range(max(map(len, ladders)))]
        return [row for ladder in ladders for row in self._ladder(run, fresh, pool, ladder, tell)]

    def _ladder(
        self, run: Run, fresh: Sequence[FreshData], pool: SolverPool, tasks: Sequence[Task], tell: Tell
    ) -> list[Row]:
        """Measure the settings of one solver lane."""
        rows: list[Row] = []
        end = ""
        for task, data in zip(tasks, fresh, strict=False):
            if rows and _is_last_limit(tasks[len(rows) - 1], rows[-1]):
                break
            tell(task)
            if run.is_done(task):
                rows += run.task(task)[0]
            elif end and task.setting.rung >= 0:
                why = f"a looser setting {end} on this problem"
                rows.append(self.save(run, task, Outcome(str(Status.NOT_RUN), why)))
            else:
                rows.append(self.measure(run, pool, task, data, self.settings.effort))
            if task.setting.rung >= 0:
                end = end or _end_of_ladder(rows[-1])
        return rows


def _end_of_ladder(row: Row) -> str:
    """Why tighter settings than that of a row are skipped on this problem, or ""."""
    if row["status"] in (Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY):
        return f"ended with {row['status']}"
    return "took longer than 0.1 s" if row["answer_us"] > LONGEST_US else ""


def _is_last_limit(task: Task, row: Row) -> bool:
    """Whether larger iteration limits than that of a task would change nothing, or take too long."""
    limit = max(task.more.values(), default=math.inf)
    return bool(task.setting.rung_text and (0 <= row["iterations"] < limit or row["answer_us"] > LONGEST_US))
