"""The batch race: small box programs per second and core, solved to a proven optimum, by batch size.

Every contestant gets each batch size, and the whole sequence is ``repeats`` times. A contestant runs in
its own process with one thread on the core that the race has claimed; contestants of the lane kernel run a second time
with a thread on every core. The parent judges a sample of the timed answers. A batch is skipped, and its row states it,
if the next smaller batch failed or predicts more than ``longest_s``.

The programs are mixtures of neighbouring windows of recordings, no two alike.

Every simulated actuator under every drive, identified with a model of d = 18 (n = 5, m = 3) or d = 60 (n = 20, m = 9),
gives a family of four windows. A program is drawn from one family,

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,   θ uniform over θ ≥ 0, Σ θ_k = 1,   lb ≤ x,

and the family is drawn for each program. Active sets, condition numbers (1e4 to 1e11) and bounds differ from program to
program. A child mixes the programs of its request, which follow from the families and a seed. Only the parent knows
which answers are judged; their optima are proven after the solvers have answered.
"""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from bench.derived.ranking import TIER_NAMES
from bench.derived.tiers import TOLERANCE
from bench.messages.columns import COUNT, NUMBER, TEXT, TYPICAL, Column, first_text, least_good, named, worst
from bench.messages.task import NO_SETTING, ChildSettings, Outcome, Progress, Request, Row, Status, Task, Tier
from bench.problems import fresh, simulation
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.solver_child import SolverPool
from bench.races.batch.contestant import WARM_UP, Batched, BatchRequest, Families, contestants, of_file
from bench.races.driver import Part, TaskRace
from bench.races.field import chosen
from bench.races.metrics import relative_gap
from bench.races.settings import OwnProblemSettings, Positive, option
from bench.report.words import gap, number, share, thousand
from bench.store import Run, Schema
from bench.timing import cores
from bench.timing.clock import Effort
from piezo_model import plants
from solvers import Described, Entry, Lane
from solvers.arrays import Matrix, Vector

ORDERS = {18: (5, 3), 60: (20, 9)}
"""Orders n and m of the model by d."""
SET = "batch"
SHARES = {"share_high": Tier.HIGH, "share_mid": Tier.MID, "share_low": Tier.LOW}
SKIPPED = "not run"
FEWEST = 2048
"""Smallest number of programs that one task solves, in many calls if its batches are smaller."""

BATCH = Schema(
    "batch.parquet",
    (
        Column("d", COUNT, heading="d"),
        Column("label", None, heading="contestant"),
        Column("lane", TEXT, heading="lane"),
        Column("threads", COUNT, heading="threads"),
        Column("batch", COUNT, heading="batch"),
        *(Column(name, NUMBER, "sum", TIER_NAMES[tier], share) for name, tier in SHARES.items()),
        Column("worst_gap", NUMBER, worst, "worst gap", gap),
        Column("rate", None, heading="thousand/s", format=thousand),
        Column("core_rate", None, heading="per core", format=thousand),
        Column("cores_busy", None, heading="cores busy", format=number),
        Column("bytes", COUNT, "first", "bytes"),
        Column("gb_s", None, heading="GB/s", format=number),
        Column("status", TEXT, least_good),
        Column("message", TEXT, first_text),
        Column("programs", COUNT, "sum"),
        Column("judged", COUNT, "sum"),
        Column("wall_us_p50", NUMBER, TYPICAL),
        Column("cpu_us_p50", NUMBER, TYPICAL),
        *named("problem_set", "problem", "solver", "scaling", "settings", "repeat"),
    ),
    ("d", "lane", "solver", "threads", "batch", "repeat"),
)
"""One row per contestant, number of threads, batch size and repeat. Times are per program, medians over the groups of
calls. ``bytes``: size of a program's data and answer. A line of the summary is a contestant with a number of threads at
one batch size, over its repeats."""


class Programs:
    """All ``count`` programs of one size, and the proofs of those whose answers are judged.

    The run stores the families, at most ``limit`` of them, so that a resumed race has the same programs.
    """

    def __init__(self, run: Run, d: int, count: int, seed: int, limit: int | None, progress: Progress) -> None:
        self._forms = [problem.forms["scaled"] for problem in _families(run, d, seed, limit, progress)]
        self.families = Families(
            np.array([[form.qp.P, *(window.P for window in form.windows)] for form in self._forms]),
            np.array([[form.qp.q, *(window.q for window in form.windows)] for form in self._forms]),
            np.array([form.qp.lb for form in self._forms]),
            np.array([form.qp.ub for form in self._forms]),
            (seed, d),
            count,
        )
        self._family, self._shares = self.families.drawn()
        self._rank = np.random.default_rng().permutation(count)  # not reproducible on purpose
        self.proven = cache(lambda b: fresh.proven_mixture(self._forms[self._family[b]], self._shares[b], np.ones(1)))
        """A program with its certified optimum; None if it cannot be proven."""

    def judged(self, first: int, last: int, most: int) -> Iterator[tuple[int, CertifiedForm]]:
        """At most ``most`` of the programs ``first`` to ``last`` − 1, each with its certified optimum, without those
        that cannot be proven; overlapping ranges share them, so that few proofs are needed."""
        chosen = sorted(first + int(i) for i in np.argsort(self._rank[first:last])[:most])
        return ((b, form) for b in chosen if (form := self.proven(b)) is not None)


def _families(run: Run, d: int, seed: int, limit: int | None, progress: Progress) -> list[RaceProblem]:
    """A problem with its windows for each actuator and drive, stored in the run."""
    cases = [(plant, drive) for plant in plants.names() for drive in simulation.DRIVES][:limit]
    problems = []
    for i, (plant, drive) in enumerate(cases):
        progress(f"{plant} under a {drive}, d = {d}", i, len(cases))
        name = f"{plant}-{drive}-{d}"
        path = run.problem_path(SET, name)
        if not path.is_file():
            simulation.Experiment(plant, drive, *ORDERS[d], seed=seed + i).problem(SET, name).save(path)
        problems.append(run.problem(SET, name))
    return problems


@dataclass(frozen=True)
class BatchSettings(OwnProblemSettings):
    """Settings of a batch race; stored with the run, so that it can be resumed."""

    effort: Effort = field(default_factory=lambda: Effort(budget_s=0.005, fewest=3, most=100))
    largest: int = option(65_536, "Programs of the largest batch; smaller ones have a quarter each.")
    repeats: Positive = 3
    """Number of times that each contestant gets each batch, in the same process."""
    judged: int = 8
    """Number of answers per task that are judged."""
    longest_s: float = 2.0

    @property
    def batches(self) -> list[int]:
        """The batch sizes: powers of 4."""
        return [4**k for k in range(32) if 4**k <= self.largest]


class BatchRace(TaskRace[BatchSettings]):
    """Contestants are interleaved at each size of a batch."""

    schema = BATCH
    preload = ("bench.races.batch.contestant",)

    @classmethod
    def entries(cls, settings: BatchSettings) -> Sequence[Entry]:
        """The selected contestants; RaceError for an unknown name."""
        return chosen(settings, contestants(), of_file, "contestant", cls.preload)

    @property
    def count(self) -> int:
        """Number of programs of each size."""
        return max(FEWEST, self.settings.batches[-1]) + self.settings.repeats + WARM_UP

    @property
    def child(self) -> ChildSettings:
        """The memory limit excludes the programs."""
        child = super().child
        return replace(child, memory_mb=child.memory_mb + 2 * 8 * self.count * max(ORDERS) ** 2 // 2**20)

    def prepare(self, resources: ExitStack) -> None:
        """Make the families."""
        settings = self.settings
        self.programs = {
            d: Programs(self.run, d, self.count, settings.seed, settings.limit or None, self.progress) for d in ORDERS
        }
        several = [entry for entry in self.entrants.values() if entry.lane is Lane.KERNEL and len(cores.usable()) > 1]
        self.parallel = resources.enter_context(SolverPool(several, self.child))

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """A part is one batch size: all contestants in random order, those of the lane kernel also with all cores."""
        players = [(1, solver) for solver in field]
        if (many := len(cores.usable())) > 1:
            players += [(many, solver) for solver in field if solver.lane is Lane.KERNEL]

        def part(repeat: int, d: int, batch: int) -> Part:
            order = random.Random(f"{self.settings.seed} {repeat} {d} {batch}").sample(players, len(players))
            return self.part(
                f"batch-{repeat}-{d}-{batch}",
                *(task_of(solver, d, batch, threads, repeat) for threads, solver in order),
            )

        yield [
            part(repeat, d, batch)
            for repeat in range(self.settings.repeats)
            for d in ORDERS
            for batch in self.settings.batches
        ]

    def measure(self, task: Task, pool: SolverPool) -> Outcome:
        """Solve the batches, unless by the next smaller batch it would fail or take too long."""
        batch = task.more["batch"]
        smaller = replace(task, more={**task.more, "batch": batch // 4})
        if batch > 1 and (reason := skip_reason(self.run.task(smaller)[0][0], batch, self.settings.longest_s)):
            return Outcome(SKIPPED, reason)
        return super().measure(task, pool if task.more["threads"] == 1 else self.parallel)

    def request(self, task: Task) -> Request:
        """The programs from the one with the number of the repeat on."""
        batch, repeat = task.more["batch"], task.repeat
        return BatchRequest(
            self.programs[task.d].families,
            batch,
            repeat,
            repeat + max(FEWEST, batch),
            task.more["threads"],
            self.settings.effort,
        )

    def known(self, task: Task, outcome: Outcome) -> Mapping[str, Any]:
        """Batch size, threads, and bytes of a program."""
        return {**task.more, "bytes": 8 * (task.d * task.d + 4 * task.d)}

    def judged(self, task: Task, outcome: Batched) -> Sequence[Mapping[str, Any]]:
        """Accuracy of the sampled answers, and times."""
        errors = self.errors(task, outcome.answers)
        shares = {
            name: float(np.mean(errors <= TOLERANCE[tier])) if errors.size else math.nan
            for name, tier in SHARES.items()
        }
        wall, cpu = (1e-3 * outcome.times[name] / outcome.programs for name in ("wall", "cpu"))
        return [
            {
                **shares,
                "status": str(Status.OK if shares["share_high"] == 1.0 else Status.MISSED),
                "judged": errors.size,
                "programs": int(outcome.programs.sum()),
                "worst_gap": float(errors.max()) if errors.size else math.nan,
                "wall_us_p50": float(np.median(wall)),
                "cpu_us_p50": float(np.median(cpu)),
            }
        ]

    def errors(self, task: Task, answers: Matrix) -> Vector:
        """The larger of relative cost gap and violation for a sample of the answers; infinite for NaN or infinity."""
        first = task.repeat
        judged = self.programs[task.d].judged(first, first + len(answers), self.settings.judged)
        return np.array([max(relative_gap(form, answers[b - first])) for b, form in judged])


def task_of(entry: Entry | Described, d: int, batch: int, threads: int, repeat: int) -> Task:
    """The task of a contestant for a batch size."""
    return Task(
        SET, f"d{d}", "scaled", entry.name, entry.lane, NO_SETTING, {"batch": batch, "threads": threads}, repeat, d=d
    )


def skip_reason(smaller: Row, batch: int, longest_s: float) -> str:
    """Why a batch is not run, given the row of the next smaller one; "" if it is run."""
    if smaller["status"] == SKIPPED:
        return str(smaller["message"])
    if smaller["status"] not in (Status.OK, Status.MISSED):
        return f"the batch of {smaller['batch']} ended as {smaller['status']}"
    expected_s = 1e-6 * smaller["wall_us_p50"] * batch
    if expected_s > longest_s:
        return f"a batch of {batch} would take {expected_s:.1f} s, and the limit is {longest_s:g} s"
    return ""
