"""The first pass over a problem: every setting of every solver, hot, in one scaling and one repeat.

The settings of a solver follow each other from loose to tight; after a crash, a timeout or an answer that takes longer
than 0.1 s, tighter settings are skipped on this problem. The tests for hidden work and for a cache are made at one
setting, drawn by the parent, so that no solver can know it; if that setting has no answer, another one is measured
again with them.
"""

import math
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from bench.messages.task import Outcome, Row, Task
from bench.messages.verdict import Status
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.sentinel import EVERY_S
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.driver import Part, Tell
from bench.races.oneshot.blocks import BlockError, Measurement, timed
from bench.races.oneshot.rows import answer_us, row_of
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

    @property
    def form(self) -> CertifiedForm:
        """The problem in this scaling."""
        return self.problem.forms[self.scaling]

    def measure(
        self, run: Run, pool: SolverPool, task: Task, fresh: FreshData, effort: Effort, test_for_cheating: bool
    ) -> Row:
        """Time, judge and save a task."""
        idle = pool.children[null_solver.ENTRY.name, null_solver.ENTRY.lane]
        try:
            measured = timed(pool.child(task), idle, task, self.problem, fresh, effort, test_for_cheating)
        except BlockError as error:
            measured = Measurement(*error.args)
        outcome, row = measured.outcome, row_of(self.problem, task, measured)
        run.save(task, [row], {"setup": outcome.setup_ns, "update": outcome.update_ns, "solve": outcome.solve_ns})
        pool.sentinel.sample(unless_within_s=EVERY_S)
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
        end, effort = "", self.settings.effort
        remaining = [task for task in tasks if not run.is_done(task)]
        tested_task, is_tested = secrets.choice(remaining or tasks), not remaining
        for task, data in zip(tasks, fresh, strict=False):
            if rows and _is_last_limit(tasks[len(rows) - 1], rows[-1]):
                break
            tell(task)
            if run.is_done(task):
                rows += run.task(task)[0]
            elif end and task.setting.rung >= 0:
                why = f"a looser setting {end} on this problem"
                rows.append(row_of(self.problem, task, Measurement(Outcome(str(Status.NOT_RUN), why))))
                run.save(task, rows[-1:], {})
            else:
                rows.append(self.measure(run, pool, task, data, effort, test_for_cheating=task is tested_task))
                is_tested |= task is tested_task and rows[-1]["samples"] > 0
            if task.setting.rung >= 0:
                end = end or _end_of_ladder(rows[-1])
        answered = [i for i, row in enumerate(rows) if row["samples"]]
        if answered and not is_tested:
            i = secrets.choice(answered)
            unseen = FreshData(self.form, effort.most)
            rows[i] = self.measure(run, pool, tasks[i], unseen, effort, test_for_cheating=True)
        return rows


def _end_of_ladder(row: Row) -> str:
    """Why tighter settings than that of a row are skipped on this problem, or ""."""
    if row["status"] in (Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY):
        return f"ended with {row['status']}"
    return "took longer than 0.1 s" if answer_us(row) > LONGEST_US else ""


def _is_last_limit(task: Task, row: Row) -> bool:
    """Whether larger iteration limits than that of a task would change nothing, or take too long."""
    limit = max(task.more.values(), default=math.inf)
    return bool(task.setting.rung_text and (0 <= row["iterations"] < limit or answer_us(row) > LONGEST_US))
