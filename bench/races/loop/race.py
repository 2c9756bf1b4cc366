"""The closed-loop race: does the accuracy of the solver matter to the stage?

Every solver learns in the same loop (`bench.stage`): two axes behind a decoupling matrix, a staircase, the paper's
cycle of reset, building, learning. All else is equal, noise included. A row holds the tracking error of one axis in one
window of the paper's cycle length, and of the weights in use at its end the time to learn and the cost gap:

    cost gap       exact, against the certified optimum of the data that the weights were learned from
    learn_samples  from the last sample of these data to the hand-over: time of the solver, and age of its answer

The paper's method takes one step per sample, in learning phases of several lengths. Any other solver runs with the
settings of `chosen_settings` for each tier, and its answer is used as soon as it is available. Each runs on a stage
that does not change and on one whose actuators drift.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta

from bench.messages.columns import COUNT, NUMBER, TEXT, Column, least_good, named, root_mean_square, worst
from bench.messages.task import PAPER, ChildSettings, Request, Status, Task, Tier, default_setting
from bench.races.chosen_settings import EACH, Choices, choices, table_of
from bench.races.driver import Part, TaskRace
from bench.races.loop.worker import Driven, LearningEnd, LoopRequest
from bench.races.settings import Positive, TierSettings, fixed
from bench.report.words import gap, whole
from bench.stage.setup import AXES, RANGE_UM, StageSetup
from bench.stage.trial import straight
from bench.store import Schema
from bench.timing.clock import Effort
from piezo_model import IdentificationProblem
from solvers.arrays import Matrix, Vector
from solvers.certificate import NotCertified, certify, exact_cost_gap
from solvers.registry import Described, Entry

SET = "loop"
STILL, DRIFTING = "still", "drifting"

LOOP = Schema(
    "loop.parquet",
    (
        Column("problem", TEXT, heading="stage"),
        Column("label", None, heading="solver"),
        Column("lane", TEXT, heading="lane"),
        Column("cost_gap", NUMBER, worst, "cost gap", gap),
        Column("rms_percent", NUMBER, root_mean_square, "RMS, %", "{:.4f}".format),
        Column("rms_um", NUMBER, root_mean_square, "RMS, nm", lambda um: f"{1e3 * um:.1f}"),
        Column("max_percent", NUMBER, worst, "largest, %", "{:.3f}".format),
        Column("max_um", NUMBER, worst, "largest, nm", lambda um: f"{1e3 * um:.0f}"),
        Column("learn_samples", NUMBER, worst, "time to learn, samples", whole),
        Column("hand_overs", NUMBER, "min", "hand-overs", whole),
        Column("refused", NUMBER, "max", "refused", whole),
        Column("status", TEXT, least_good, "status"),
        Column("setting", TEXT, "first"),
        Column("basis", TEXT, "first"),
        Column("straight_rms_percent", NUMBER, root_mean_square),
        *named("problem_set", "d", "solver", "tier", "scaling", "settings", "repeat", "message"),
        Column("axis", TEXT),
        Column("window", COUNT),
        *named("error_old", "error_new", "faults"),
    ),
    ("problem", "solver", "lane", "tier", "settings", "repeat", "axis", "window"),
)
"""One row per axis and window. ``hand_overs`` and ``refused`` are counted up to the window's end; gap, time and
errors of learning are those of the last hand-over, NaN before the first one. Errors are in percent of the reference's
range. A line of the summary is a solver with its settings on one stage in the last window: the errors of both axes
together, and the cost gap and time to learn of the worse axis."""


@dataclass(frozen=True)
class LoopSettings(TierSettings):
    """Settings of a closed-loop race; stored with the run, so that it can be resumed."""

    tiers: tuple[Tier, ...] = (Tier.DEFAULT, Tier.HIGH)
    effort: Effort = fixed(Effort())
    learn_steps: Annotated[tuple[Positive, ...], Meta(min_length=1)] = (1, 10, 100, 1000, 15200)
    """Learning phases of the paper's method, in samples."""
    windows: Positive = 5
    drift_per_s: float = 5e-4
    quick: bool = False
    """Short phases, for tests."""

    def stage(self, problem: str, repeat: int = 0) -> StageSetup:
        """The setup of a problem with the paper's learner; stage, reference and noise are those of all learners."""
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
    """Each solver races in one lane, that of :func:`solvers.find`: a lane changes the time and no answer."""

    schema = LOOP
    preload = ("bench.races.loop.worker",)
    timed = False
    failed: ClassVar = {"window": -1, "hand_overs": 0, "refused": 0, "faults": 0}

    @classmethod
    def entries(cls, settings: LoopSettings) -> Sequence[Entry]:
        """Each solver in its preferred lane."""
        preferred: dict[Any, Entry] = {}
        for entry in sorted(super().entries(settings), key=lambda entry: entry.is_fallback):
            preferred.setdefault((entry.name, entry.path), entry)
        return list(preferred.values())

    @property
    def child(self) -> ChildSettings:
        """The time limit is extended by the duration of the reference."""
        still = self.settings.stage(STILL)
        return replace(super().child, time_limit_s=self.settings.time_limit_s + len(still.y_ref) * still.sample_time)

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """All tasks in one part."""
        yield [self.part(SET, *self.tasks(field))]

    def tasks(self, field: Sequence[Described]) -> Iterator[Task]:
        """Every solver at each tier on both stages; the paper's method with each length of the learning phase."""
        settings, (table, run) = self.settings, table_of(self.settings.settings_run)
        d = settings.stage(STILL).structures[0].d
        for repeat, problem, solver in product(range(settings.repeats), (STILL, DRIFTING), field):
            chosen: Choices = choices(solver, settings.tiers, table, run)
            phases: list[dict[str, int]] = [{}]
            if solver.name == PAPER:
                chosen = {default_setting(solver): {settings.tiers[0]: EACH}}
                phases = [{"steps": steps} for steps in settings.learn_steps]
            for (setting, basis), more in product(chosen.items(), phases):
                yield Task(SET, problem, "scaled", solver.name, solver.lane, setting, more, repeat, d=d, basis=basis)

    def request(self, task: Task) -> Request:
        """Follow the whole reference."""
        return LoopRequest(task, self.settings.setup(task), self.entrants[task.solver, task.lane].path)

    def judged(self, task: Task, outcome: Driven) -> Sequence[Mapping[str, Any]]:
        """One row per axis and window."""
        settings, setup = self.settings, self.settings.setup(task)
        error_um, length = outcome.platform - setup.y_ref, len(setup.y_ref) // settings.windows
        straight_percent = straight_rms_percent(settings.stage(task.problem, task.repeat))
        rows = []
        for i, axis in enumerate(AXES):
            ends = [(end.event.sample, hand_over_columns(end)) for end in outcome.ends[i]]
            status, message = status_of(outcome.ends[i])
            for window in range(settings.windows):
                part = error_um[window * length : (window + 1) * length, i]
                so_far = [numbers for sample, numbers in ends if sample <= (window + 1) * length]
                hand_overs = [numbers for numbers in so_far if numbers]
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
                        "hand_overs": len(hand_overs),
                        "refused": len(so_far) - len(hand_overs),
                        "faults": outcome.faults,
                        **(hand_overs[-1] if hand_overs else {}),
                    }
                )
        return rows


def status_of(ends: Sequence[LearningEnd]) -> tuple[Status, str]:
    """Whether any learned weights were used, and the reason if none were."""
    if any(end.is_hand_over for end in ends):
        return Status.OK, ""
    message = ends[-1].event.message if ends else "no learning phase came to its end"
    return Status.SOLVER_FAILED if message.startswith("the solver") else Status.MISSED, message


@lru_cache(maxsize=8)
def straight_rms_percent(setup: StageSetup) -> Matrix:
    """RMS errors (windows, 2) of the same stage driven along the straight line."""
    trial = straight(setup)
    return np.array([trial.rms_percent(window) for window in range(setup.cycles)])


def hand_over_columns(end: LearningEnd) -> dict[str, float]:
    """Time to learn, exact cost gap and errors at a hand-over; empty for a refusal."""
    if not end.is_hand_over or end.problem is None:
        return {}
    event = end.event
    return {
        "learn_samples": event.sample - event.learning_since,
        "cost_gap": cost_gap(end.problem, end.weights),
        "error_old": event.error_old,
        "error_new": event.error_new,
    }


def cost_gap(problem: IdentificationProblem, weights: Vector) -> float:
    """Exact relative cost gap of weights (d,); NaN if the optimum cannot be proven."""
    form = problem.form()
    z: Vector = np.maximum(form.variables(weights), form.qp.lb)
    try:
        certificate = certify(form.qp, z)
    except NotCertified:
        return np.nan
    return float(exact_cost_gap(form.qp, certificate, z, form.c).relative)
