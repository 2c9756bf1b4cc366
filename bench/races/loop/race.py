"""The closed-loop race: does the accuracy of the solver matter to the stage?

Every solver learns in the same loop (`bench.stage`): two axes behind a decoupling matrix, a staircase, the paper's
cycle of reset, building, learning. All else is equal, noise included. A row holds the tracking error of one axis in one
window of the paper's cycle length, the time to learn, and how exact and how old the weights are that were in use at its
end.

    cost gap      exact, of the weights taken over against the certified optimum of the data that they were learned from
    samples       from the last sample that was learned from to the decision: what the solver took, and how old the
                  answer is that comes into use

The paper's method stands there with learning phases of several lengths, one step a sample; any other solver at its
tiers, with the settings of `chosen_settings`, and its answer is taken over as soon as it is there. Both for a stage
that stays as it is and for one whose actuators drift.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from bench.messages.columns import COUNT, TEXT
from bench.messages.race_error import RaceError
from bench.messages.task import Request, Task
from bench.processes.worker import ChildSettings
from bench.races.chosen_settings import EACH, choices, default_setting, table_of
from bench.races.driver import Part, TaskRace
from bench.races.loop.worker import Decision, Driven, LoopRequest
from bench.races.settings import TierSettings, fixed
from bench.stage.setup import AXES, RANGE_UM, StageSetup
from bench.stage.trial import straight
from bench.store import Schema
from bench.timing.clock import Effort
from piezo_model import IdentificationProblem
from solvers import Status, Tier
from solvers.arrays import Matrix, Vector
from solvers.certificate import NotCertified, certify, exact_cost_gap
from solvers.registry import Described, Entry

KIND = "loop"
STILL, DRIFTING = "still", "drifting"
PAPER = "projected_difference"

LOOP = Schema(
    "loop.parquet",
    (
        "problem_set",
        "problem",
        "d",
        "solver",
        "lane",
        "tier",
        "setting",
        "basis",
        "scaling",
        "settings",
        "repeat",
        "status",
        "message",
        "axis",
        "window",
        "rms_percent",
        "max_percent",
        "rms_um",
        "max_um",
        "straight_rms_percent",
        "hand_overs",
        "refused",
        "learn_samples",
        "cost_gap",
        "error_old",
        "error_new",
        "faults",
    ),
    ("problem", "solver", "lane", "tier", "settings", "repeat", "axis", "window"),
    types={"axis": TEXT, "window": COUNT},
)
"""One row an axis and window. ``hand_overs`` and ``refused`` until the window's end; what follows them is of the last
hand-over, and NaN before there is one; errors in percent of the reference's range."""


@dataclass(frozen=True)
class LoopSettings(TierSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    tiers: tuple[Tier, ...] = (Tier.DEFAULT, Tier.HIGH)
    effort: Effort = fixed(Effort())
    learn_steps: tuple[int, ...] = (1, 10, 100, 1000, 15200)
    """Learning phases of the paper's method, in samples."""
    windows: int = 5
    drift_per_s: float = 5e-4
    quick: bool = False
    """Short phases, for tests."""

    def __post_init__(self) -> None:
        """RaceError for what cannot race in the loop."""
        super().__post_init__()
        if self.windows < 1 or not self.learn_steps or min(self.learn_steps) < 1:
            raise RaceError("the loop needs at least one window and learning phases of at least one sample")

    def stage(self, problem: str, repeat: int = 0) -> StageSetup:
        """The setup of a problem with the paper's learner; all learners get its stage, reference and noise."""
        return (StageSetup.quick if self.quick else StageSetup)(
            cycles=self.windows,
            seed=self.seed + repeat,
            gain_drift_per_s=self.drift_per_s if problem == DRIFTING else 0.0,
        )

    def setup(self, task: Task) -> StageSetup:
        """The setup of a task."""
        setup = replace(
            self.stage(task.problem, task.repeat), solver=task.solver, lane=str(task.lane), setting=task.setting.text
        )
        steps = task.more.get("steps")
        return setup if steps is None else replace(setup, learn_s=steps * setup.sample_time, samples=len(setup.y_ref))


class LoopRace(TaskRace[LoopSettings]):
    """Every solver in the lane only in which :func:`solvers.find` has it: a lane changes the time and no answer."""

    schema = LOOP
    preload = ("bench.races.loop.worker",)
    timed = False
    failed = MappingProxyType({"window": -1, "hand_overs": 0, "refused": 0, "faults": 0})

    @classmethod
    def entries(cls, settings: LoopSettings) -> Sequence[Entry]:
        """Each solver once."""
        first: dict[Any, Entry] = {}
        for entry in sorted(super().entries(settings), key=lambda entry: entry.comes_last):
            first.setdefault((entry.name, entry.path), entry)
        return list(first.values())

    @property
    def child(self) -> ChildSettings:
        """A solver may take as long as the stage follows its reference, and its limit."""
        still = self.settings.stage(STILL)
        return replace(super().child, time_limit_s=self.settings.time_limit_s + len(still.y_ref) * still.sample_time)

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """All tasks, one after the other."""
        yield [self.part(KIND, *self.tasks(field))]

    def tasks(self, field: Sequence[Described]) -> Iterator[Task]:
        """Every solver at each tier on both stages; the paper's method with each length of the learning phase."""
        settings, (table, run) = self.settings, table_of(self.settings.settings_run)
        d = settings.stage(STILL).structures[0].d
        for repeat in range(settings.repeats):
            for problem in (STILL, DRIFTING):
                for solver in field:
                    its, phases = choices(solver, settings.tiers, table, run), [dict[str, int]()]
                    if solver.name == PAPER:
                        its, phases = (
                            {default_setting(solver): {settings.tiers[0]: EACH}},
                            [{"steps": steps} for steps in settings.learn_steps],
                        )
                    for setting, basis in its.items():
                        for more in phases:
                            yield Task(
                                KIND,
                                problem,
                                "scaled",
                                solver.name,
                                solver.lane,
                                setting,
                                more,
                                repeat,
                                d=d,
                                basis=basis,
                            )

    def request(self, task: Task) -> Request:
        """The whole reference."""
        return LoopRequest(task, self.settings.setup(task), self.entrants[task.solver, task.lane].path)

    def judged(self, task: Task, outcome: Driven) -> Sequence[Mapping[str, Any]]:
        """One row an axis and window."""
        settings, setup = self.settings, self.settings.setup(task)
        error_um, length = outcome.platform - setup.y_ref, len(setup.y_ref) // settings.windows
        straight_percent = straight_rms_percent(settings.stage(task.problem, task.repeat))
        rows = []
        for i, axis in enumerate(AXES):
            decisions = [(decision.sample, of_decision(decision)) for decision in outcome.decisions[i]]
            status, message = status_of(outcome.decisions[i])
            for window in range(settings.windows):
                part = error_um[window * length : (window + 1) * length, i]
                seen = [figures for sample, figures in decisions if sample <= (window + 1) * length]
                taken = [figures for figures in seen if figures]
                rms_um, max_um = float(np.sqrt(np.mean(part**2))), float(np.abs(part).max())
                rows.append(
                    {
                        "status": str(status),
                        "message": message,
                        "axis": axis,
                        "window": window,
                        "rms_um": rms_um,
                        "max_um": max_um,
                        "rms_percent": 100.0 / RANGE_UM * rms_um,
                        "max_percent": 100.0 / RANGE_UM * max_um,
                        "straight_rms_percent": float(straight_percent[window, i]),
                        "hand_overs": len(taken),
                        "refused": len(seen) - len(taken),
                        "faults": outcome.faults,
                        **(taken[-1] if taken else {}),
                    }
                )
        return rows


def status_of(decisions: Sequence[Decision]) -> tuple[Status, str]:
    """Whether anything that was learned was taken over, and why not."""
    if any(decision.taken for decision in decisions):
        return Status.OK, ""
    message = decisions[-1].message if decisions else "no learning phase came to its end"
    return Status.SOLVER_FAILED if message.startswith("the solver") else Status.MISSED, message


@lru_cache(maxsize=8)
def straight_rms_percent(setup: StageSetup) -> Matrix:
    """RMS error (windows, 2) along the straight line on the same stage."""
    run = straight(setup)
    return np.array([run.rms_percent(window) for window in range(setup.cycles)])


def of_decision(decision: Decision) -> dict[str, float]:
    """Times and exact cost gap of weights that were taken over; nothing where they were not."""
    if not decision.taken or decision.problem is None:
        return {}
    return {
        "learn_samples": decision.sample - decision.learned_until,
        "cost_gap": cost_gap(decision.problem, decision.weights),
        "error_old": decision.error_old,
        "error_new": decision.error_new,
    }


def cost_gap(problem: IdentificationProblem, weights: Vector) -> float:
    """Relative cost gap of weights (d,), exact; NaN where no optimum could be proven."""
    form = problem.form()
    z: Vector = np.maximum(form.variables(weights), form.qp.lb)
    try:
        certificate = certify(form.qp, z)
    except NotCertified:
        return np.nan
    return float(exact_cost_gap(form.qp, certificate, z, form.c).relative)
