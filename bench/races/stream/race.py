"""The stream race: a drifting actuator sample by sample on an absolute schedule of 8 kHz, and what lateness costs.

Each solver lane follows the same rows in a fresh process, the order shuffled with the seed in every round. A null
solver that answers at once runs first and after every FLOOR_EVERY others: its response times are the machine's floor,
and where they change in the course of a run the machine does. Every finished task is on disk before the next one
starts.

A solver whose answers are late at each of the first ``give_up`` samples is stopped there, and marked.
"""

import json
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.derived.accuracy import TOLERANCE
from bench.messages.columns import FLAG, TEXT
from bench.messages.task import NO_SETTING, Outcome, Request, Row, Setting, Task, settings_of
from bench.problem_files.program import fields_of
from bench.problems.drift import DRIFT_PER_S, TIME_CONSTANT_S
from bench.problems.simulation import Experiment
from bench.processes.solver_child import SolverPool
from bench.processes.worker import ChildSettings
from bench.races import null_solver
from bench.races.chosen_settings import DEFAULT, EACH, Choices, choices, table_of
from bench.races.driver import Part, TaskRace
from bench.races.settings import Positive, TierSettings, fixed, option
from bench.races.stream.stream_problem import StreamProblem, make
from bench.races.stream.worker import KERNEL_WALL_S, Streamed, StreamRequest
from bench.store import Schema
from bench.timing.clock import Effort
from bench.timing.schedule import PERIOD_NS, Timeline, runs
from piezo_model.json_file import decoded
from solvers import Lane, Status, Tier
from solvers.arrays import Nanoseconds
from solvers.registry import Described, Entry

KIND = "stream"
FLOOR_EVERY = 10

STREAM = Schema(
    "stream.parquet",
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
        "paced",
        "samples",
        "solves",
        "stopped",
        "missed",
        "stalls",
        "unanswered",
        "reused",
        "gap_mean",
        "gap_max",
        "exact_gap_mean",
        "exact_gap_max",
        "exact_instants",
        "exact_difference",
        "own_gap_max",
        "data_us_p50",
        "update_us_p50",
        "solve_us_p50",
        "mutates_input",
    ),
    ("problem", "lane", "solver", "tier", "settings", "repeat"),
    types={"stopped": TEXT, "paced": FLAG},
)
"""One row a process. ``missed`` deadlines, in how many ``stalls``; ``unanswered`` solves; ``reused`` share of samples
at whose deadline an older answer was in use; gaps of the answers in use, of all samples in doubles and of the proven
instants exactly; ``own_gap_max`` of each answer at its own sample."""


@dataclass(frozen=True)
class StreamSettings(TierSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    effort: Effort = fixed(Effort())
    samples: int = option(30_000, "Samples of a stream.")
    kernel_samples: Positive = 1_000_000
    give_up: Positive = 4_000
    certified: Positive = 300
    """Instants at which the optimum is proven."""
    plant: str = "relay_preisach"
    drive: str = "random_walk"
    drift_per_s: float = DRIFT_PER_S
    time_constant_s: float = TIME_CONSTANT_S

    @property
    def experiment(self) -> Experiment:
        """The actuator and its drive."""
        return Experiment(self.plant, self.drive, drift_per_s=self.drift_per_s, seed=self.seed)


class StreamRace(TaskRace[StreamSettings]):
    """Every solver lane on the same rows."""

    schema = STREAM
    preload = ("bench.races.stream.worker",)
    floor = True
    failed = dict.fromkeys(("solves", "missed", "stalls", "unanswered", "exact_instants"), 0)

    @property
    def child(self) -> ChildSettings:
        """A solver may be as long again as the stream."""
        return replace(
            super().child, time_limit_s=self.settings.time_limit_s + 2.0 * self.settings.samples * PERIOD_NS * 1e-9
        )

    def prepare(self, resources: ExitStack) -> None:
        """Make the stream."""
        settings = self.settings
        self.progress(f"{settings.samples} samples with {settings.certified} proven optima", 0, 1)
        self.stream = make(settings.experiment, settings.samples, settings.time_constant_s, settings.certified)

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """Each task is watched by itself."""
        yield [self.part(task.key, task) for task in self.tasks(field)]

    def tasks(self, field: Sequence[Described]) -> Iterator[Task]:
        """All tasks, round by round, each round in an order of its own; the null solver first and after every few.

        A method that counts steps takes each of its numbers of them.
        """
        table, run = table_of(self.settings.settings_run)

        def task(solver: Described | Entry, setting: Setting, basis: Mapping[Tier, str], repeat: int) -> Task:
            return Task(
                KIND,
                self.stream.name,
                "scaled",
                solver.name,
                solver.lane,
                setting,
                repeat=repeat,
                d=self.stream.d,
                basis=basis,
            )

        def of(solver: Described) -> Choices:
            if "steps" in solver.ladder[0]:
                return {setting: {self.settings.tiers[0]: EACH} for setting in settings_of(solver) if setting.rung >= 0}
            return choices(solver, self.settings.tiers, table, run)

        chance, floors = random.Random(self.settings.seed), 0
        for repeat in range(self.settings.repeats):
            tasks = [task(solver, setting, basis, repeat) for solver in field for setting, basis in of(solver).items()]
            chance.shuffle(tasks)
            for i, each in enumerate(tasks):
                if i % FLOOR_EVERY == 0:
                    yield task(null_solver.ENTRY, NO_SETTING, {Tier.DEFAULT: DEFAULT}, floors)
                    floors += 1
                yield each

    def in_loop(self, task: Task) -> int:
        """How many samples its compiled loop is asked for; 0 on the schedule."""
        return (
            self.settings.kernel_samples
            if task.lane is Lane.KERNEL and self.entrants[task.solver, task.lane].times_itself
            else 0
        )

    def request(self, task: Task) -> Request:
        """The whole stream."""
        s, give_up = self.stream, 0 if task.solver == null_solver.ENTRY.name else self.settings.give_up
        return StreamRequest(task, fields_of(s.start), s.c, s.answer, s.rows, s.forgetting, self.in_loop(task), give_up)

    def measure(self, task: Task, pool: SolverPool) -> Outcome:
        """Each task has a process of its own."""
        outcome = super().measure(task, pool)
        pool.child(task).close()
        return outcome

    def known(self, task: Task, outcome: Outcome) -> Mapping[str, Any]:
        """How it was timed, and of the settings the number of steps."""
        steps = {name: count for name, count in decoded(task.setting.text, dict[str, Any]).items() if name == "steps"}
        return {"settings": json.dumps(steps), "paced": not self.in_loop(task), "mutates_input": outcome.mutated}

    def judged(self, task: Task, outcome: Streamed) -> Sequence[Mapping[str, Any]]:
        """How many deadlines, and what the answers in use were worth."""
        timed = (
            _unpaced(outcome.kernel_ns, self.in_loop(task))
            if outcome.timeline is None
            else _paced(outcome.timeline, self.settings.samples)
        )
        return [{**timed, **_worth(outcome, self.stream)}]

    def rows(self, task: Task, outcome: Outcome) -> list[Row]:
        """With the status at each tier: whether its own answers reach it; what the stage notices is not looked at
        here."""
        rows = super().rows(task, outcome)
        for row in rows:
            if not outcome.failure:
                reached = row["unanswered"] == 0 and row["own_gap_max"] <= TOLERANCE.get(
                    row["tier"], TOLERANCE[Tier.LOW]
                )
                row["status"] = str(Status.OK if reached else Status.MISSED)
        return rows


def _paced(t: Timeline, wanted: int) -> dict[str, Any]:
    return {
        "samples": t.samples,
        "solves": t.solved.size,
        "missed": int(t.late.sum()),
        "stalls": t.stalls,
        "stopped": "" if t.samples == wanted else f"late at each of the first {t.samples} samples",
        "data_us_p50": float(np.median(t.data_ns)) / 1e3,
        "update_us_p50": float(np.median(t.updated - t.began)) / 1e3,
        "solve_us_p50": float(np.median(t.ended - t.updated)) / 1e3,
    }


def _unpaced(ns: Nanoseconds, wanted: int) -> dict[str, Any]:
    return {
        "samples": ns.size,
        "solves": ns.size,
        "missed": int((ns > PERIOD_NS).sum()),
        "stalls": runs(ns > PERIOD_NS),
        "stopped": "" if ns.size == wanted else f"after {KERNEL_WALL_S:g} s",
        "solve_us_p50": float(np.median(ns)) / 1e3,
    }


def _worth(outcome: Streamed, stream: StreamProblem) -> dict[str, Any]:
    """Gaps of the answers in use and of the solver's own."""
    answers, t = outcome.answers, outcome.timeline
    if answers.shape[1:] != (stream.d,):
        return {"exact_instants": 0, "unanswered": len(answers)}
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(answers).all(axis=1))
    solved = np.arange(len(answers)) if t is None else t.solved
    used = np.where(usable, solved, -1) if t is None else t.in_use(usable)
    gaps = stream.gaps(answers, used)
    instants, exact = stream.exact_gaps(answers, used)
    own = np.full(gaps.size, -1)
    own[solved] = np.arange(solved.size)
    own_gaps = stream.gaps(answers, own)[solved[usable]]
    fresh = used >= 0
    fresh[fresh] = solved[used[fresh]] == np.flatnonzero(fresh)
    return {
        "unanswered": int((~usable).sum()),
        "reused": float(1.0 - fresh.mean()),
        "gap_mean": float(gaps.mean()),
        "gap_max": float(gaps.max()),
        "exact_gap_mean": float(exact.mean()) if exact.size else np.nan,
        "exact_gap_max": float(exact.max()) if exact.size else np.nan,
        "exact_instants": int(exact.size),
        "exact_difference": float(np.abs(gaps[instants] - exact).max()) if exact.size else np.nan,
        "own_gap_max": float(own_gaps.max()) if own_gaps.size else np.nan,
    }
