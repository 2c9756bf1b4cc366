"""The child's side of the batch race: times one contestant on batches of one size, call by call.

Every call gets programs that no earlier call got, until all programs have been used; they are read once beforehand, so
that they are in memory. Calls are timed in groups of at least GROUP_NS, in wall time and in CPU time of all threads of
the process. An answer is copied into an array inside its time, so that a lazy result is computed there. Compiling,
loading and allocating are not timed; they happen on programs that are not timed later.
"""

import math
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.messages.solver_info import real
from bench.messages.task import Outcome, Request
from bench.races.batch.contestant import Contestant, OneByOne
from bench.timing.clock import Effort, no_garbage_collection
from solvers.arrays import Matrix, Nanoseconds
from solvers.protocol import Solver

GROUP_NS = 1_000_000
"""Shortest group of calls that is timed as one."""
WARM_UP = 64
"""Number of programs at the end of the files that are used for the warm-up and not timed; they are repeated for a
contestant that compiles for a larger batch."""


@dataclass(frozen=True)
class Files:
    """Files with the arrays of all programs of one size, which a child maps."""

    folder: Path
    d: int
    count: int

    @property
    def _shapes(self) -> list[tuple[Path, tuple[int, ...]]]:
        """Each file with the shape of its array for one program."""
        shapes = {"P": (self.d, self.d), "q": (self.d,), "lb": (self.d,), "ub": (self.d,)}
        return [(self.folder / f"{name}-{self.d}", shape) for name, shape in shapes.items()]

    def reserve(self) -> None:
        """Create the files at their full size; OSError if there is no space for them."""
        for path, shape in self._shapes:
            with path.open("xb") as file:
                os.posix_fallocate(file.fileno(), 0, 8 * self.count * math.prod(shape))

    def mapped(self, first: int, last: int, mode: Literal["c", "r+"] = "c") -> tuple[Matrix, ...]:
        """P (n, d, d), q, lb and ub (n, d) of programs ``first`` to ``last`` − 1; by default writes stay in the
        process."""
        return tuple(
            np.memmap(path, np.float64, mode, 8 * first * math.prod(shape), (last - first, *shape))
            for path, shape in self._shapes
        )


@dataclass
class Batched(Outcome):
    """Answers (M, d) to the first M programs of the request, and for each group of calls its times and its number of
    programs."""

    answers: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    wall_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    cpu_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    programs: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    grown_mb: float = float("nan")

    @property
    def times(self) -> Mapping[str, Nanoseconds]:
        """Wall time and CPU time of the groups of calls."""
        return {"wall": self.wall_ns, "cpu": self.cpu_ns}


@dataclass(frozen=True)
class BatchRequest(Request):
    """Solve programs ``first`` to ``last`` − 1 in batches of ``size``, with ``threads`` threads."""

    files: Files
    size: int
    first: int
    last: int
    threads: int
    effort: Effort

    def answer(self, cls: Any, first: bool) -> Outcome:
        """Warm up, then time."""
        contestant = ready(cls, self.files.d, self.threads)
        solve, arrays = contestant.solve, [np.asarray(array) for array in self.files.mapped(self.first, self.last)]
        for array in arrays:
            array.sum()  # reads the array into memory
        warm_up_size = self.size if contestant.compiles else min(self.size, WARM_UP)
        warm_up = [
            np.resize(array, (warm_up_size, *array.shape[1:]))
            for array in self.files.mapped(self.files.count - WARM_UP, self.files.count)
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
        spent, memory_before = 0, memory_mb("VmRSS")
        reset_peak_memory()
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
        if any(x.shape != (self.size, self.files.d) for x in answers):
            raise ValueError(f"answers a batch of {self.size} programs with an array of shape {answers[0].shape}")
        wall_ns, cpu_ns, programs = np.array(times, dtype=np.int64).T
        return Batched(
            found=True,
            answers=np.concatenate(answers),
            wall_ns=wall_ns,
            cpu_ns=cpu_ns,
            programs=programs,
            grown_mb=memory_mb("VmHWM") - memory_before,
        )


@cache
def ready(cls: Any, d: int, threads: int) -> Contestant | OneByOne:
    """The contestant of this process for programs of d variables; it may keep the memory that it allocated."""
    return OneByOne(cls(), d) if issubclass(cls, Solver) else cls(d, threads)


def memory_mb(field: str) -> float:
    """Current (VmRSS) or peak (VmHWM) resident memory of this process in megabytes; NaN if the system does not report
    it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    fields = dict(line.split(":", 1) for line in status.splitlines())
    return float(fields.get(field, "nan").split()[0]) / 1024.0


def reset_peak_memory() -> None:
    """Restart the peak of the resident memory, if the system allows it."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
