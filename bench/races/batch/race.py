"""The batch race: how many small box programs a second and core are solved to a proven optimum, by the size of the batch.

Contestants take turns: each batch size is given to one after the other, and all sizes ``turns`` times. A contestant runs in a process of
its own, with one thread on the core that the race has claimed, and where it is parallel once more with a thread on every core. Of the
answers that were timed the parent judges a sample. Where a batch would by the one before take longer than ``longest_s``, or the one
before had no answer, it is not run, and the row says so.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa

from bench.derived.accuracy import TOLERANCE
from bench.passed.outcome import Outcome
from bench.passed.progress import Progress
from bench.passed.row import Row, who
from bench.passed.task import NO_SETTING, Task
from bench.processes.engine import Workers
from bench.processes.line_up import LineUp
from bench.races.batch.contestant import ContestantFile, contestants, of_file
from bench.races.batch.programs import ORDERS, SET, SHARED_MEMORY, WARM_UP, Programs, reserved
from bench.races.batch.worker import Batched, BatchRequest
from bench.races.conditions import note_conditions, watched
from bench.races.field import chosen, field_of
from bench.races.metrics import relative_gap
from bench.races.settings import OwnProblemSettings, Positive, fixed, option, settings_of
from bench.store import Run, Schema
from bench.timing import cores
from bench.timing.clock import Effort
from solvers import Lane, Status, Tier
from solvers.arrays import Matrix
from solvers.registry import Entry

NAN = float("nan")
TIERS = (Tier.LOW, Tier.MID, Tier.HIGH)
SHARES = tuple(f"share_{tier}" for tier in TIERS)
SKIPPED = "not run"
FEWEST = 2048
"""Programs that batches of fewer are taken from, call by call."""

BATCH = Schema("batch.parquet", (
    "problem_set", "problem", "d", "solver", "lane", "scaling", "settings", "repeat", "status", "message",
    "batch", "threads", "programs", "judged", *SHARES, "worst_gap", "wall_us_p50", "cpu_us_p50", "bytes", "grown_mb"),
    ("d", "lane", "solver", "threads", "batch", "repeat"),
    types=dict.fromkeys(("batch", "threads", "programs", "judged", "bytes"), pa.int64()))
"""One row a contestant, number of threads, batch size and turn. Times are of one program, medians of the groups of calls.
``bytes`` is what a program's data and answer are; ``grown_mb`` the memory that the calls took."""


@dataclass(frozen=True)
class BatchSettings(OwnProblemSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    repeats: Positive = fixed(1)
    effort: Effort = field(default_factory=lambda: Effort(budget_s=0.005, fewest=3, most=100))
    sizes: tuple[int, ...] = tuple(ORDERS)
    largest: int = option(65_536, "Programs of the largest batch; smaller ones have a quarter each.")
    turns: int = option(3, "Times that each contestant gets each batch.")
    judged: int = 8
    """Answers of a batch that are judged."""
    longest_s: float = 2.0

    @property
    def batches(self) -> list[int]:
        """The batch sizes, from 1 on."""
        return [4**k for k in range(32) if 4**k <= self.largest]


def asked_for(settings: BatchSettings) -> list[ContestantFile]:
    """The contestants that are asked for; RaceError where there is none of a name."""
    return chosen(settings, contestants(), of_file, "contestant")


def race(run: Run, progress: Progress, workers: Workers) -> None:
    """Do whatever is not done yet."""
    settings = settings_of(run, BatchSettings)
    entries = asked_for(settings)
    with ExitStack() as stack:
        count = max(FEWEST, settings.batches[-1]) + settings.turns + WARM_UP
        folder = stack.enter_context(reserved(settings.sizes, count))
        programs = {d: Programs(run, d, count, settings.seed, folder, settings.limit or None, progress) for d in settings.sizes}
        of_programs = 2 * 8 * count * max(settings.sizes)**2 // 2**20  # those that are timed, and those to warm up on
        limits = replace(settings.limits, memory_mb=settings.memory_mb + of_programs)
        progress("waiting for a core on which no other race times", 0, 1)
        core = stack.enter_context(cores.claim())
        alone = stack.enter_context(LineUp(entries, limits, core.number))
        names = {(solver.name, solver.lane) for solver in field_of(run, alone.children.values())}
        entries = [entry for entry in entries if (entry.name, entry.lane) in names]
        several = [entry for entry in entries if entry.lane is Lane.KERNEL and len(cores.usable()) > 1]
        line_ups = {1: alone, len(cores.usable()): stack.enter_context(LineUp(several, limits, None))} if several else {1: alone}
        players = [(1, entry) for entry in entries] + [(len(cores.usable()), entry) for entry in several]
        for turn in range(settings.turns):
            for d in settings.sizes:
                for batch in settings.batches:
                    with watched(run, f"batch-{turn}-{d}-{batch}", alone.sentinel):
                        _turn(run, settings, programs[d], line_ups, players, batch, turn, progress)
    note_conditions(run, workers, [] if folder.parent == SHARED_MEMORY else [
        f"The programs lay in {folder.parent}, since {SHARED_MEMORY} had no room for them; a disk may have been at work beside the race."])


def task_of(entry: Entry, d: int, batch: int, threads: int, turn: int) -> Task:
    """A contestant's turn at a batch size."""
    return Task(SET, f"d{d}", "scaled", entry.name, entry.lane, NO_SETTING, more={"batch": batch, "threads": threads}, repeat=turn)


def _turn(run: Run, settings: BatchSettings, programs: Programs, line_ups: Mapping[int, LineUp], players: Sequence[tuple[int, Entry]],
          batch: int, turn: int, progress: Progress) -> None:
    """One batch size by all, each with a number of threads, in an order of its own."""
    d, chance = programs.files.d, random.Random(f"{settings.seed} {turn} {programs.files.d} {batch}")
    for done, (threads, entry) in enumerate(chance.sample(players, len(players))):
        progress(f"batches of {batch}, d = {d}, turn {turn + 1} of {settings.turns}: {entry.name}", done, len(players))
        task = task_of(entry, d, batch, threads, turn)
        if not run.is_done(task):
            before = task_of(entry, d, batch // 4, threads, turn)
            why = _why_not(run.task(before)[0][0], batch, settings.longest_s) if batch > 1 else ""
            outcome = Outcome(SKIPPED, why) if why else line_ups[threads].children[entry.name, entry.lane].ask(
                BatchRequest(programs.files, batch, turn, turn + max(FEWEST, batch), threads, settings.effort))
            run.save(task, row_of(task, outcome, programs, settings.judged), times_of(outcome))


def _why_not(before: Row, batch: int, longest_s: float) -> str:
    """Why a batch is not run after what became of the one before; "" where it is."""
    if before["status"] == SKIPPED:
        return str(before["message"])
    if before["status"] not in (Status.OK, Status.MISSED):
        return f"the batch of {before['batch']} ended as {before['status']}"
    expected_s = 1e-6 * before["wall_us_p50"] * batch
    return f"a batch of {batch} would take {expected_s:.1f} s, and the most is {longest_s:g} s" if expected_s > longest_s else ""


def times_of(outcome: Outcome) -> dict[str, Any]:
    """Raw nanoseconds of the groups of calls, by the clock and by the processors."""
    return {"wall": outcome.wall_ns, "cpu": outcome.cpu_ns} if isinstance(outcome, Batched) else {}


def row_of(task: Task, outcome: Outcome, programs: Programs, most: int) -> Row:
    """Who, how right and how fast."""
    d = programs.files.d
    row = BATCH.row(**who(task, d), **task.more, status=outcome.failure, message=outcome.message,
                    bytes=8 * (d * d + 4 * d))
    if not isinstance(outcome, Batched):
        return row
    errors = np.array([*_errors(programs, task.repeat, outcome.answers, most)])
    shares = {f"share_{tier}": float(np.mean(errors <= TOLERANCE[tier])) if errors.size else NAN for tier in TIERS}
    wall, cpu = (1e-3 * ns / outcome.programs for ns in (outcome.wall_ns, outcome.cpu_ns))
    return {**row, **shares, "status": str(Status.OK if shares["share_high"] == 1.0 else Status.MISSED), "judged": errors.size,
            "programs": int(outcome.programs.sum()), "worst_gap": float(errors.max()) if errors.size else NAN,
            "wall_us_p50": float(np.median(wall)), "cpu_us_p50": float(np.median(cpu)), "grown_mb": outcome.grown_mb}


def _errors(programs: Programs, first: int, answers: Matrix, most: int) -> Iterator[float]:
    """Of a sample of the answers the larger of relative cost gap and violation, infinite where there is none."""
    for b in programs.sample(first, first + len(answers), most):
        if (form := programs.proven(b)) is not None:
            x = answers[b - first]
            yield max(relative_gap(form, x)) if np.isfinite(x).all() else math.inf
