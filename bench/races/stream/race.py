"""The stream race: a drifting actuator sample by sample on an absolute schedule of 8 kHz, and what lateness costs.

Each solver lane follows the same rows in a fresh process, the order shuffled with the seed in every round. A null solver
that answers at once runs first and after every FLOOR_EVERY others: its response times are the machine's floor, and where
they change in the course of a run the machine does. Every finished task is on disk before the next one starts.

A solver whose answers are late at each of the first ``give_up`` samples is stopped there, and marked.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.derived.accuracy import TOLERANCE
from bench.passed.outcome import Outcome
from bench.passed.progress import Progress
from bench.passed.row import Row, who
from bench.passed.task import NO_SETTING, Task, settings_of
from bench.problem_files.program import fields_of
from bench.problems.drift import DRIFT_PER_S, TIME_CONSTANT_S
from bench.problems.simulation import Experiment
from bench.processes.engine import Workers
from bench.processes.line_up import LineUp
from bench.races import null_solver
from bench.races.chosen_settings import DEFAULT, EACH, Choice, choices, table_of
from bench.races.conditions import note_conditions, watched
from bench.races.field import checked, field_of
from bench.races.settings import Positive, TierSettings, fixed, option
from bench.races.settings import settings_of as settings_of_run
from bench.races.stream.staleness import Judge
from bench.races.stream.stream_problem import StreamProblem, make
from bench.races.stream.worker import KERNEL_WALL_S, Streamed, StreamRequest
from bench.store import Run, Schema
from bench.timing import cores, latency_histogram
from bench.timing.clock import Effort
from bench.timing.schedule import PERIOD_NS, runs
from piezo_model.json_file import decoded
from solvers import Lane, Status, Tier
from solvers.registry import Described, Entry

KIND = "stream"
FLOOR_EVERY = 10
NAN = float("nan")

STREAM = Schema("stream.parquet", (
    "problem_set", "problem", "d", "solver", "lane", "tier", "setting", "basis", "scaling", "settings", "repeat", "status", "message", "paced",
    "samples", "solves", "stopped", "missed", "stalls", "unanswered", "reused", "gap_mean", "gap_max", "exact_gap_mean",
    "exact_gap_max", "exact_instants", "exact_difference", "own_gap_max", "data_us_p50", "update_us_p50", "solve_us_p50",
    "service_histogram", "response_histogram", "mutates_input"),
    ("problem", "lane", "solver", "tier", "settings", "repeat"))
"""One row a process. ``missed`` deadlines, in how many ``stalls``; ``unanswered`` solves; ``reused`` share of samples at
whose deadline an older answer was in use; gaps of the answers in use, of all samples in doubles and of the proven instants
exactly; ``own_gap_max`` of each answer at its own sample; the histograms as of `latency_histogram`, in the kernel lane the
second is the first corrected for the period."""


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


def check(settings: StreamSettings) -> list[Entry]:
    """The entries that are asked for; RaceError or RunError unless there is all that is asked for."""
    table_of(settings.settings_run)
    return checked(settings)


def race(run: Run, progress: Progress, workers: Workers) -> None:
    """Do whatever is not done yet."""
    settings = settings_of_run(run, StreamSettings)
    chosen = check(settings)
    stream = _stream(run, settings, progress)
    schedule_s = settings.samples * PERIOD_NS * 1e-9
    limits = replace(settings.limits, time_limit_s=settings.time_limit_s + 2.0 * schedule_s)
    progress("waiting for a core on which no other race times", 0, 1)
    with cores.claim() as core, LineUp([null_solver.ENTRY, *chosen], limits, core.number) as line_up:
        floor, *children = line_up.children.values()
        floor.describe()
        field = field_of(run, children)
        _race(run, settings, stream, list(tasks_of(settings, field, stream)), line_up, progress)
    note_conditions(run, workers)


def _stream(run: Run, settings: StreamSettings, progress: Progress) -> StreamProblem:
    """Make the stream and keep it, or load the one that was kept."""
    path = run.problem_path(KIND, f"{settings.plant}-{settings.drive}")
    if not path.is_file():
        progress(f"{settings.samples} samples with {settings.certified} proven optima", 0, 1)
        make(settings.experiment, settings.samples, settings.time_constant_s, settings.certified).save(path)
    return StreamProblem.load(path)


def tasks_of(settings: StreamSettings, field: Sequence[Described], stream: StreamProblem) -> Iterator[tuple[Task, Choice]]:
    """All tasks, round by round, each round in an order of its own; the null solver first and after every few.

    A method that counts steps takes each of its numbers of them.
    """
    def task(name: str, lane: Lane, choice: Choice, repeat: int) -> tuple[Task, Choice]:
        return Task(KIND, stream.name, "scaled", name, lane, choice.setting, repeat=repeat), choice

    table, name = table_of(settings.settings_run)

    def of(solver: Described) -> Sequence[Choice]:
        if "steps" in solver.ladder[0]:
            return [Choice(setting, {settings.tiers[0]: EACH}) for setting in settings_of(solver) if setting.rung >= 0]
        return choices(solver, settings.tiers, table, name)

    chance, floors = random.Random(settings.seed), 0
    for repeat in range(settings.repeats):
        tasks = [task(solver.name, solver.lane, choice, repeat) for solver in field for choice in of(solver)]
        chance.shuffle(tasks)
        for i, each in enumerate(tasks):
            if i % FLOOR_EVERY == 0:
                yield task(null_solver.ENTRY.name, null_solver.ENTRY.lane, Choice(NO_SETTING, {Tier.DEFAULT: DEFAULT}), floors)
                floors += 1
            yield each


def _race(run: Run, settings: StreamSettings, stream: StreamProblem, tasks: Sequence[tuple[Task, Choice]], line_up: LineUp,
          progress: Progress) -> None:
    """Do the tasks that are not done, each in a fresh process."""
    judge = Judge.of(stream)
    fields = fields_of(stream.start)
    for done, (task, choice) in enumerate(tasks):
        progress(f"{task.solver} ({task.lane})", done, len(tasks))
        if not run.is_done(task):
            child = line_up.children[task.solver, task.lane]
            in_loop = settings.kernel_samples if task.lane is Lane.KERNEL and child.entry.times_itself else 0
            give_up = 0 if task.solver == null_solver.ENTRY.name else settings.give_up
            with watched(run, task.key, line_up.sentinel):
                outcome = child.ask(StreamRequest(task, fields, stream.c, stream.answer, stream.rows, stream.forgetting,
                                                  in_loop, give_up))
            child.close()
            run.save(task, rows_of(task, choice, outcome, judge, in_loop), times_of(outcome))


def times_of(outcome: Outcome) -> dict[str, Any]:
    """Raw nanoseconds by what was timed."""
    if not isinstance(outcome, Streamed):
        return {}
    if outcome.timeline is None:
        return {"service": outcome.kernel_ns}
    t = outcome.timeline
    return {"service": t.service_ns, "response": t.response_ns, "data": t.data_ns, "update": t.updated - t.began,
            "sample": t.solved, "began": t.began}


def rows_of(task: Task, choice: Choice, outcome: Outcome, judge: Judge, in_loop: int) -> list[Row]:
    """The rows of a task, one a tier: who, how many deadlines, and what the answers in use were worth.

    ``in_loop`` is how many samples its compiled loop was asked for; 0 on the schedule.
    """
    steps = {name: count for name, count in decoded(task.setting.text, dict[str, Any]).items() if name == "steps"}
    row = STREAM.row(**who(task, judge.stream.d, steps), status=outcome.failure, message=outcome.message,
                     paced=not in_loop, mutates_input=outcome.mutated,
                     **dict.fromkeys(("solves", "missed", "stalls", "unanswered", "exact_instants"), 0))
    if not isinstance(outcome, Streamed):
        return [{**row, "tier": str(tier), "basis": basis} for tier, basis in choice.basis.items()]
    row |= _paced(outcome, judge) if outcome.timeline else _unpaced(outcome, in_loop)
    row |= _worth(outcome, judge)
    return [{**row, "tier": str(tier), "basis": basis, "status": str(_status(row, tier))} for tier, basis in choice.basis.items()]


def _status(row: Row, tier: Tier) -> Status:
    """Whether the solver's own answers reach the tier; what the stage notices is not looked at here."""
    return Status.OK if row["unanswered"] == 0 and row["own_gap_max"] <= TOLERANCE.get(tier, TOLERANCE[Tier.LOW]) else Status.MISSED


def _paced(outcome: Streamed, judge: Judge) -> dict[str, Any]:
    t = outcome.timeline
    assert t is not None
    whole = len(judge.stream.rows)
    return {"samples": t.samples, "solves": t.solved.size, "missed": int(t.late.sum()), "stalls": t.stalls,
            "stopped": "" if t.samples == whole else f"late at each of the first {t.samples} samples",
            "data_us_p50": float(np.median(t.data_ns)) / 1e3, "update_us_p50": float(np.median(t.updated - t.began)) / 1e3,
            "solve_us_p50": float(np.median(t.ended - t.updated)) / 1e3,
            "service_histogram": latency_histogram.recorded(t.service_ns),
            "response_histogram": latency_histogram.recorded(t.response_ns)}


def _unpaced(outcome: Streamed, wanted: int) -> dict[str, Any]:
    ns = outcome.kernel_ns
    return {"samples": ns.size, "solves": ns.size, "missed": int((ns > PERIOD_NS).sum()), "stalls": runs(ns > PERIOD_NS),
            "stopped": "" if ns.size == wanted else f"after {KERNEL_WALL_S:g} s", "data_us_p50": NAN,
            "update_us_p50": NAN, "solve_us_p50": float(np.median(ns)) / 1e3,
            "service_histogram": latency_histogram.recorded(ns),
            "response_histogram": latency_histogram.recorded(ns, PERIOD_NS)}


def _worth(outcome: Streamed, judge: Judge) -> dict[str, Any]:
    """Gaps of the answers in use and of the solver's own."""
    answers, t = outcome.answers, outcome.timeline
    if answers.shape[1:] != (judge.stream.d,):
        return {**dict.fromkeys(("gap_mean", "gap_max", "exact_gap_mean", "exact_gap_max", "exact_difference", "own_gap_max",
                                 "reused"), NAN), "exact_instants": 0, "unanswered": len(answers)}
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(answers).all(axis=1))
    solved = np.arange(len(answers)) if t is None else t.solved
    used = np.where(usable, solved, -1) if t is None else t.in_use(usable)
    gaps = judge.gaps(answers, used)
    instants, exact = judge.exact_gaps(answers, used)
    own = np.full(gaps.size, -1)
    own[solved] = np.arange(solved.size)
    own_gaps = judge.gaps(answers, own)[solved[usable]]
    own_max = float(own_gaps.max()) if own_gaps.size else NAN
    fresh = used >= 0
    fresh[fresh] = solved[used[fresh]] == np.flatnonzero(fresh)
    return {"unanswered": int((~usable).sum()), "reused": float(1.0 - fresh.mean()), "gap_mean": float(gaps.mean()),
            "gap_max": float(gaps.max()), "exact_gap_mean": float(exact.mean()) if exact.size else NAN,
            "exact_gap_max": float(exact.max()) if exact.size else NAN, "exact_instants": int(exact.size),
            "exact_difference": float(np.abs(gaps[instants] - exact).max()) if exact.size else NAN,
            "own_gap_max": own_max}
