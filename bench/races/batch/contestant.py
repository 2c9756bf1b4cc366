"""Contestants of a batch race, the files that define them, and the child's side of the race, which times one.

A contestant is either a class of this race, compiled code that is called once for a whole batch, or a solver of the
lane direct, which :class:`OneByOne` calls for one program after the other.

Every call gets programs that no earlier call got, until all programs of the request have been used; they are mixed
beforehand. Calls are timed in groups of at least GROUP_NS, in wall time and in CPU time of all threads of
the process. An answer is copied into an array inside its time, so that a lazy result is computed there. Compiling,
loading and allocating are not timed; they happen on programs that are not timed later.
"""

import time
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem

from bench.messages.solver_info import real
from bench.messages.task import Outcome, Request
from bench.timing.clock import Effort, no_garbage_collection
from solvers import Entry, Lane, find
from solvers.arrays import Index
from solvers.protocol import Entrant, Matrix, Solver

DIRECT = ("box_active_set", "daqp", "pyqpmad", "quadprog")
"""The fastest solvers of the lane direct."""
GROUP_NS = 1_000_000
"""Shortest group of calls that is timed as one."""
WARM_UP = 64
"""Number of programs at the end that are used for the warm-up and not timed; they are repeated for a contestant that
compiles for a larger batch."""
CHUNK = 32
"""Number of programs that are mixed at once, in the processor's cache."""


class Contestant(Entrant):
    """Solves batches of programs  minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub  of d variables.

    Its settings aim at a relative cost gap of 1e-9, if the library has such settings. It uses at most ``threads``
    threads, in the lane direct one.
    """

    compiles: ClassVar[bool] = False
    """Whether it compiles for each batch size; compilation is not timed."""

    def __init__(self, d: int, threads: int) -> None:
        self.d, self.threads = d, threads

    @abstractmethod
    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """Answers (B, d) to the programs P (B, d, d) with q, lb, ub (B, d); NaN for a program without an answer."""


class OneByOne:
    """Calls a solver of the lane direct for one program after the other; sets it up again when the bounds change."""

    compiles = False

    def __init__(self, solver: Solver, d: int) -> None:
        self._solver, self._lb, self._ub = solver, np.full(d, np.nan), np.full(d, np.nan)

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """Answers to the programs, as of :class:`Contestant`."""
        x, solver = np.empty(q.shape), self._solver
        changed = ((lb != np.vstack([self._lb, lb[:-1]])) | (ub != np.vstack([self._ub, ub[:-1]]))).any(axis=1)
        for b in range(len(q)):
            if changed[b]:
                solver.setup(Problem(P[b], q[b], lb=lb[b], ub=ub[b]))
            else:
                solver.update(P=P[b], q=q[b])
            x[b] = solver.solve()
        self._lb, self._ub = lb[-1], ub[-1]
        return x


@dataclass(frozen=True)
class ContestantFile(Entry):
    """A file that defines a contestant; not yet imported."""

    base = Contestant


def contestants() -> Iterator[Entry]:
    """All contestants by lane and name."""
    folder = Path(__file__).parent / "contestants"
    for file in sorted(folder.glob("[a-z]*.py")):
        yield ContestantFile(file.stem, Lane.KERNEL, f"{__package__}.contestants.{file.stem}")
    for name in DIRECT:
        yield find(name, Lane.DIRECT)


def of_file(path: str | Path) -> ContestantFile:
    """The contestant of a user's own file, in the lane direct; ImportError if the file defines none."""
    path = Path(path).resolve()
    entry = ContestantFile(path.stem, Lane.DIRECT, f"piezobench_user_{path.stem}", path)
    entry.load()
    return entry


@dataclass(frozen=True)
class Families:
    """The windows of F families of programs of one size, and the seed from which ``count`` programs are drawn."""

    P: NDArray[np.float64]
    """Shape (F, windows, d, d)."""
    q: NDArray[np.float64]
    """Shape (F, windows, d)."""
    lb: Matrix
    ub: Matrix
    """Shape (F, d)."""
    seed: tuple[int, ...]
    count: int

    @property
    def d(self) -> int:
        """Number of variables of a program."""
        return self.lb.shape[1]

    def drawn(self) -> tuple[Index, Matrix]:
        """The family (count,) of each program, and the shares (count, windows) of its windows."""
        random = np.random.default_rng(self.seed)
        return (
            random.integers(len(self.P), size=self.count),
            random.dirichlet(np.ones(self.P.shape[1]), size=self.count),
        )

    def block(self, first: int, last: int) -> tuple[NDArray[np.float64], Matrix, Matrix, Matrix]:
        """P (n, d, d), q, lb and ub (n, d) of programs ``first`` to ``last`` − 1."""
        family, shares = (array[first:last] for array in self.drawn())
        P, q = np.empty((last - first, self.d, self.d)), np.empty((last - first, self.d))
        for f, windows in enumerate(zip(self.P, self.q, strict=True)):
            members = np.flatnonzero(family == f)
            for at in range(0, members.size, CHUNK):
                chunk = members[at : at + CHUNK]
                parts = [*zip(shares[chunk].T, *windows, strict=True)]
                P[chunk] = sum(share[:, None, None] * window_P for share, window_P, _ in parts)
                q[chunk] = sum(share[:, None] * window_q for share, _, window_q in parts)
        return P, q, self.lb[family], self.ub[family]


@dataclass
class Batched(Outcome):
    """Answers (M, d) to the first M programs of the request, and for each group of calls its wall and CPU time and its
    number of programs."""

    programs: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


@dataclass(frozen=True)
class BatchRequest(Request):
    """Solve programs ``first`` to ``last`` − 1 in batches of ``size``, with ``threads`` threads."""

    families: Families
    size: int
    first: int
    last: int
    threads: int
    effort: Effort

    def answer(self, cls: Any, first: bool) -> Outcome:
        """Warm up, then time."""
        contestant = ready(cls, self.families.d, self.threads)
        solve, arrays = contestant.solve, self.families.block(self.first, self.last)
        warm_up_size = self.size if contestant.compiles else min(self.size, WARM_UP)
        warm_up = [
            np.resize(array, (warm_up_size, *array.shape[1:]))
            for array in self.families.block(self.families.count - WARM_UP, self.families.count)
        ]
        began = time.perf_counter_ns()
        np.array(solve(*warm_up))
        per_call = (time.perf_counter_ns() - began) * self.size // warm_up_size
        batches = [
            [array[at : at + self.size] for array in arrays]
            for at in range(0, self.last - self.first - self.size + 1, self.size)
        ]
        calls = int(np.clip(GROUP_NS // max(per_call, 1), 1, max(1, len(batches) // self.effort.fewest)))
        groups = [batches[at : at + calls] for at in range(0, len(batches), calls)][: self.effort.most]
        answers: list[Matrix] = []
        times: list[tuple[int, int, int]] = []
        spent = 0
        with no_garbage_collection():
            for group in groups:
                if not self.effort.goes_on(len(times), spent):
                    break
                cpu, wall = time.process_time_ns(), time.perf_counter_ns()
                copies = [np.array(solve(*batch)) for batch in group]
                wall, cpu = time.perf_counter_ns() - wall, time.process_time_ns() - cpu
                answers += [real(x) for x in copies]
                times.append((wall, cpu, len(group) * self.size))
                spent += wall
        if any(x.shape != (self.size, self.families.d) for x in answers):
            raise ValueError(f"answers a batch of {self.size} programs with an array of shape {answers[0].shape}")
        wall_ns, cpu_ns, programs = np.array(times, dtype=np.int64).T
        return Batched(
            found=True,
            answers=np.concatenate(answers),
            times={"wall": wall_ns, "cpu": cpu_ns},
            programs=programs,
        )


@cache
def ready(cls: Any, d: int, threads: int) -> Contestant | OneByOne:
    """The contestant of this process for programs of d variables; it may keep the memory that it allocated."""
    return OneByOne(cls(), d) if issubclass(cls, Solver) else cls(d, threads)
