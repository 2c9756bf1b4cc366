"""The stream race: a drifting actuator sample by sample on an absolute schedule of 8 kHz, and the cost of late answers.

Each solver lane follows the same rows in a fresh process, in an order that is shuffled with the seed in every round. A
null solver that answers at once runs first and after every FLOOR_EVERY others. Its response times are the machine's
floor; if they change during a run, the machine has changed. Every finished task is on disk before the next one starts.

A solver whose answers to the first ``give_up`` samples are all late is stopped there, and its row states it.
"""

import json
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.derived.tiers import TOLERANCE
from bench.messages.columns import COUNT, NUMBER, TEXT, TYPICAL, Column, first_text, least_good, named, worst
from bench.messages.task import (
    NO_SETTING,
    PAPER,
    ChildSettings,
    Outcome,
    Request,
    Row,
    Setting,
    Status,
    Task,
    Tier,
    settings_ladder,
)
from bench.problems.simulation import DRIFT_PER_S, FORGOTTEN_S, Experiment
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.chosen_settings import DEFAULT, EACH, choices, table_of
from bench.races.driver import Part, TaskRace
from bench.races.settings import Positive, TierSettings, fixed, option
from bench.races.stream.stream_problem import StreamProblem, make
from bench.races.stream.worker import Streamed, StreamRequest
from bench.report.words import gap, marked, number, settings_label, share, whole
from bench.store import Schema
from bench.timing.clock import Effort
from bench.timing.schedule import PERIOD_NS, runs
from piezo_model.json_file import decoded
from solvers import Described, Entry

SET = "stream"
FLOOR_EVERY = 10

STREAM = Schema(
    "stream.parquet",
    (
        Column("solver", TEXT, heading="solver", format=marked),
        Column("lane", TEXT, heading="lane"),
        Column("tier", TEXT),
        Column("settings", TEXT, heading="settings", format=settings_label),
        Column("setting", TEXT),
        Column("basis", TEXT, "first"),
        Column("status", TEXT, least_good, "status"),
        Column("processes", None, "size", of="task"),
        Column("samples", COUNT, "sum", "rows", whole),
        Column("solves", NUMBER, "sum", "solves", whole),
        Column("stopped", TEXT, first_text, "stopped"),
        Column("message", TEXT, first_text, "message"),
        Column("missed", NUMBER, "sum"),
        Column("stalls", NUMBER, "sum", "bouts", whole),
        Column("unanswered", NUMBER, "sum", "unanswered", whole),
        Column("gap_mean", NUMBER, "mean", "mean", gap),
        Column("gap_max", NUMBER, worst, "max", gap),
        Column("exact_gap_mean", NUMBER, "mean", "exact mean", gap),
        Column("exact_gap_max", NUMBER, worst, "exact max", gap),
        Column("exact_difference", NUMBER, worst),
        Column("own_gap_max", NUMBER, worst, "own answers", gap),
        Column("reused", NUMBER, "mean", "reused", share),
        Column("data_us_p50", NUMBER, TYPICAL),
        Column("update_us_p50", NUMBER, TYPICAL, "update p50", number),
        Column("solve_us_p50", NUMBER, TYPICAL, "solve p50", number),
        *named("problem_set", "problem", "d", "scaling", "repeat", "exact_instants", "mutates_input"),
    ),
    ("problem", "lane", "solver", "tier", "settings", "repeat"),
)
"""One row per process. ``missed``: deadlines, in ``stalls`` runs; ``unanswered``: solves without an answer; ``reused``:
share of samples at whose deadline an older answer was in use; gaps of the answers in use, in doubles at all samples and
exact at the proven instants; ``own_gap_max``: largest gap of an answer at its own sample. A line of the summary is a
solver in one lane, at one tier, with its settings, over its processes."""


@dataclass(frozen=True)
class StreamSettings(TierSettings):
    """Settings of a stream race; stored with the run, so that it can be resumed."""

    effort: Effort = fixed(Effort())
    samples: int = option(30_000, "Samples of a stream.")
    give_up: Positive = 4_000
    certified: Positive = 300
    """Number of samples at which the optimum is proven."""

    @property
    def experiment(self) -> Experiment:
        """The actuator and its drive."""
        return Experiment("relay_preisach", "random_walk", drift_per_s=DRIFT_PER_S, seed=self.seed)


class StreamRace(TaskRace[StreamSettings]):
    """Every solver lane on the same rows."""

    schema = STREAM
    preload = ("bench.races.stream.worker",)
    floor = True
    failed = dict.fromkeys(("solves", "missed", "stalls", "unanswered", "exact_instants"), 0)

    @property
    def child(self) -> ChildSettings:
        """The time limit is extended by twice the duration of the stream."""
        return replace(
            super().child, time_limit_s=self.settings.time_limit_s + 2.0 * self.settings.samples * PERIOD_NS * 1e-9
        )

    def prepare(self, resources: ExitStack) -> None:
        """Make the stream."""
        settings = self.settings
        self.progress(f"{settings.samples} samples with {settings.certified} proven optima", 0, 1)
        self.stream = make(settings.experiment, settings.samples, FORGOTTEN_S, settings.certified)

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """A part is one task."""
        yield [self.part(task.key, task) for task in self.tasks(field)]

    def tasks(self, field: Sequence[Described]) -> Iterator[Task]:
        """All tasks, round by round, each round in a random order; the null solver first and after every few.

        A solver whose ladder counts steps races at every rung.
        """
        table, run = table_of(self.settings.settings_run)
        generator, floors, first_tier = random.Random(self.settings.seed), count(), self.settings.tiers[0]

        def task(solver: Described | Entry, setting: Setting, basis: Mapping[Tier, str], repeat: int) -> Task:
            name, d = self.stream.name, self.stream.d
            return Task(SET, name, "scaled", solver.name, solver.lane, setting, repeat=repeat, d=d, basis=basis)

        for repeat in range(self.settings.repeats):
            tasks = []
            for solver in field:
                chosen = choices(solver, self.settings.tiers, table, run)
                if solver.name == PAPER:
                    steps = [
                        setting for setting in settings_ladder(solver) if [*decoded(setting.text, dict)] == ["steps"]
                    ]
                    chosen = {setting: {first_tier: EACH} for setting in steps}
                tasks += [task(solver, setting, basis, repeat) for setting, basis in chosen.items()]
            generator.shuffle(tasks)
            for i, shuffled in enumerate(tasks):
                if i % FLOOR_EVERY == 0:
                    yield task(null_solver.ENTRY, NO_SETTING, {Tier.DEFAULT: DEFAULT}, next(floors))
                yield shuffled

    def request(self, task: Task) -> Request:
        """Follow the whole stream."""
        s, give_up = self.stream, 0 if task.solver == null_solver.ENTRY.name else self.settings.give_up
        return StreamRequest(task, s.start, s.c, s.answer, s.rows, s.forgetting, give_up)

    def measure(self, task: Task, pool: SolverPool) -> Outcome:
        """Each task has its own process."""
        outcome = super().measure(task, pool)
        pool.child(task).close()
        return outcome

    def known(self, task: Task, outcome: Outcome) -> Mapping[str, Any]:
        """The number of steps, if the solver counts them, and whether it changed its input."""
        steps = {name: count for name, count in decoded(task.setting.text, dict[str, Any]).items() if name == "steps"}
        return {"settings": json.dumps(steps), "mutates_input": outcome.mutated}

    def judged(self, task: Task, outcome: Streamed) -> Sequence[Mapping[str, Any]]:
        """Missed deadlines, times, and gaps of the answers."""
        t = outcome.timeline
        medians = {"data": t.data_ns, "update": t.updated - t.began, "solve": t.ended - t.updated}
        return [
            {
                "samples": t.samples,
                "solves": t.solved.size,
                "missed": int(t.late.sum()),
                "stalls": runs(t.late),
                "stopped": ""
                if t.samples == self.settings.samples
                else f"late at each of the first {t.samples} samples",
                **{f"{name}_us_p50": float(np.median(ns)) / 1e3 for name, ns in medians.items()},
                **_gaps(outcome, self.stream),
            }
        ]

    def rows(self, task: Task, outcome: Outcome) -> list[Row]:
        """With the status at each tier: whether every answer reaches it at its own sample."""
        rows = super().rows(task, outcome)
        for row in rows:
            if not outcome.failure:
                tolerance = TOLERANCE.get(row["tier"], TOLERANCE[Tier.LOW])
                reached = row["unanswered"] == 0 and row["own_gap_max"] <= tolerance
                row["status"] = str(Status.OK if reached else Status.MISSED)
        return rows


def _gaps(outcome: Streamed, stream: StreamProblem) -> dict[str, Any]:
    """Gaps of the answers in use, and of each answer at its own sample."""
    answers, t = outcome.answers, outcome.timeline
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(answers).all(axis=1))
    solved, used = t.solved, t.in_use(usable)
    gaps = stream.gaps(answers, used)
    instants, exact = stream.exact_gaps(answers, used)
    own = np.full(gaps.size, -1)
    own[solved] = np.arange(solved.size)
    own_gaps = stream.gaps(answers, own)[solved[usable]]
    fresh = (used >= 0) & (solved[used] == np.arange(used.size))
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
