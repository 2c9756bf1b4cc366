"""The restart race: how long the first answer takes after the data have jumped, as where a stage is given another
actuator.

A problem is two building phases of the same model, each on an actuator of its own; the second has a proven optimum.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from bench.races.restart.worker import Restart, Restarted

from bench.messages.columns import COUNT
from bench.messages.task import Request, Task
from bench.problem_files.program import fields_of
from bench.problems.simulation import Experiment
from bench.races.chosen_settings import choices, table_of
from bench.races.driver import Part, TaskRace
from bench.races.kind import Kind
from bench.races.metrics import relative_gap
from bench.races.settings import TierSettings, fixed, option
from bench.report.report import Report, Table
from bench.store import Run, Schema
from bench.timing.clock import Effort
from solvers import Status
from solvers.registry import Described

JUMPS = {
    "stiffer": ("dense_prandtl_ishlinskii", "relay_preisach"),
    "softer": ("relay_preisach", "dense_prandtl_ishlinskii"),
}
"""The actuators before and after, by the name of a problem."""

RESTART = Schema(
    "restart.parquet",
    (
        "problem_set",
        "problem",
        "d",
        "solver",
        "lane",
        "tier",
        "basis",
        "setting",
        "scaling",
        "settings",
        "repeat",
        "status",
        "message",
        "answers",
        "worst_gap",
        "first_us_p50",
    ),
    ("problem", "solver", "lane", "tier", "repeat"),
    types={"answers": COUNT},
)


@dataclass(frozen=True)
class RestartSettings(TierSettings):
    """What is raced and how."""

    effort: Effort = fixed(Effort())
    jumps: int = option(20, "Jumps of the data that each solver is put through.")
    known_s: float = option(0.5, "Seconds of data on either side of a jump.", least=0.1)


class RestartRace(TaskRace[RestartSettings]):
    """Every solver after every jump."""

    schema = RESTART
    preload = ("bench.races.restart.worker",)

    def prepare(self, resources: ExitStack) -> None:
        for name, plants in JUMPS.items():
            for plant, when in zip(plants, ("before", "after"), strict=True):
                path = self.run.problem_path("restart", f"{name}-{when}")
                if not path.is_file():
                    self.progress(f"{plant}, {when} the jump", 0, 1)
                    Experiment(
                        plant, "multi_sine", n=2, m=1, build_s=self.settings.known_s, seed=self.settings.seed
                    ).problem("restart", f"{name}-{when}").save(path)
        self.forms = {
            (name, when): self.run.problem("restart", f"{name}-{when}").forms["scaled"]
            for name in JUMPS
            for when in ("before", "after")
        }

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        table, run = table_of(self.settings.settings_run)
        yield [
            self.part(
                f"{name}-{repeat}",
                *(
                    Task(
                        "restart",
                        name,
                        "scaled",
                        solver.name,
                        solver.lane,
                        setting,
                        repeat=repeat,
                        basis=basis,
                        d=self.forms[name, "after"].qp.q.size,
                    )
                    for solver in field
                    for setting, basis in choices(solver, self.settings.tiers, table, run).items()
                ),
            )
            for repeat in range(self.settings.repeats)
            for name in JUMPS
        ]

    def request(self, task: Task) -> Request:
        before, after = (self.forms[task.problem, when] for when in ("before", "after"))
        return Restart(task, fields_of(before.qp), fields_of(after.qp), before.unit, self.settings.jumps)

    def judged(self, task: Task, outcome: Restarted) -> Sequence[Mapping[str, Any]]:
        gaps = [max(relative_gap(self.forms[task.problem, "after"], x)) for x in outcome.answers]
        return [
            {
                "status": str(Status.OK if max(gaps) <= 1e-6 else Status.MISSED),
                "answers": len(gaps),
                "worst_gap": max(gaps),
                "first_us_p50": float(np.median(outcome.first_ns)) / 1e3,
            }
        ]


def report(run: Run) -> Report:
    rows = run.rows(RESTART)
    right = rows[rows.status == Status.OK]
    shown = ("problem", "solver", "lane", "tier", "status", "first_us_p50")
    return Report(
        [f"{len(right)} of {len(rows)} solver lanes were right after the jump."],
        Table("After the jump", shown, rows[list(shown)].astype(str).to_numpy().tolist(), 5),
        rows,
        definitions=["first_us_p50: update and solve, in the median."],
    )


KIND = Kind(
    "restart", "Restart race", "the first answer after a jump of the data", RestartSettings, RestartRace, report
)
