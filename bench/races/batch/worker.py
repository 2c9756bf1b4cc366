"""The child's side of the batch race: one contestant, batches of one size, timed call by call.

Each call gets programs that the calls before it did not get, until all have been through; what the batches hold is read
once before, so that it is in memory. Calls are timed in groups that last GROUP_NS, by the clock and by what the process
and all its threads took of the processors; an answer is copied as an array of our own inside its time, so that what is
computed only when it is looked at is computed there. What is compiled, loaded and allocated first is not timed, and is
done on programs that are not timed later.
"""

import math
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.messages.solver_info import real
from bench.messages.task import Outcome, Request
from bench.races.batch.contestant import Contestant
from bench.timing.clock import Effort, no_garbage_collection
from solvers.arrays import Matrix, Nanoseconds

GROUP_NS = 1_000_000
WARM_UP = 64
"""The last of the programs, which are not timed; repeated where a contestant compiles for a size of batch that is
larger."""

_ready: dict[tuple[Any, ...], Contestant] = {}
"""Contestants of this process, which may keep what they allocated."""


@dataclass(frozen=True)
class Files:
    """Where the arrays of the programs of one size are; all that a child is told of them."""

    folder: Path
    d: int
    count: int

    @property
    def _shapes(self) -> list[tuple[Path, tuple[int, ...]]]:
        """Each file with the shape of what it holds of one program."""
        shapes = {"P": (self.d, self.d), "q": (self.d,), "lb": (self.d,), "ub": (self.d,)}
        return [(self.folder / f"{name}-{self.d}", shape) for name, shape in shapes.items()]

    def reserve(self) -> None:
        """Make the files with all of their room; OSError where there is less."""
        for path, shape in self._shapes:
            with path.open("xb") as file:
                os.posix_fallocate(file.fileno(), 0, 8 * self.count * math.prod(shape))

    def mapped(self, first: int, last: int, mode: Literal["c", "r+"] = "c") -> tuple[Matrix, ...]:
        """P (n, d, d), q, lb and ub (n, d) of the programs from ``first`` to ``last`` − 1; what is written to copies
        stays in the process."""
        return tuple(
            np.memmap(path, np.float64, mode, 8 * first * math.prod(shape), (last - first, *shape))
            for path, shape in self._shapes
        )


@dataclass
class Batched(Outcome):
    """What came back: answers (M, d) to the programs from the first on, and per group of calls nanoseconds and
    programs."""

    answers: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    wall_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    cpu_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    programs: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    grown_mb: float = float("nan")

    @property
    def times(self) -> Mapping[str, Nanoseconds]:
        """Of the groups of calls, by the clock and by the processors."""
        return {"wall": self.wall_ns, "cpu": self.cpu_ns}


@dataclass(frozen=True)
class BatchRequest(Request):
    """Solve batches of ``size`` programs of those from ``first`` to ``last`` − 1 with so many threads."""

    files: Files
    size: int
    first: int
    last: int
    threads: int
    effort: Effort

    def answer(self, cls: type[Any], first: bool) -> Outcome:
        """Warm up, then time."""
        key = cls, self.files.d, self.threads
        if key not in _ready:
            _ready[key] = cls(self.files.d, self.threads)
        solve, arrays = _ready[key].solve, [np.asarray(array) for array in self.files.mapped(self.first, self.last)]
        for array in arrays:
            array.sum()  # which reads it
        few = self.size if cls.compiles else min(self.size, WARM_UP)
        others = [
            np.resize(array, (few, *array.shape[1:]))
            for array in self.files.mapped(self.files.count - WARM_UP, self.files.count)
        ]
        began = time.perf_counter_ns()
        np.array(solve(*others))
        per_call = (time.perf_counter_ns() - began) * self.size // few
        batches = [
            [array[at : at + self.size] for array in arrays]
            for at in range(0, len(arrays[1]) - self.size + 1, self.size)
        ]
        calls = int(np.clip(GROUP_NS // max(per_call, 1), 1, max(1, len(batches) // self.effort.fewest)))
        groups = [batches[at : at + calls] for at in range(0, len(batches), calls)][: self.effort.most]
        before, spent = memory_mb("VmRSS"), 0
        answers: list[Matrix] = []
        taken: list[tuple[int, int, int]] = []
        forget_peak()
        with no_garbage_collection():
            for group in groups:
                if not self.effort.goes_on(len(taken), spent):
                    break
                cpu, wall = time.process_time_ns(), time.perf_counter_ns()
                found = [np.array(solve(*batch)) for batch in group]
                wall, cpu = time.perf_counter_ns() - wall, time.process_time_ns() - cpu
                answers += [real(x) for x in found]
                taken.append((wall, cpu, len(group) * self.size))
                spent += wall
        if any(x.shape != (self.size, self.files.d) for x in answers):
            raise ValueError(f"answers a batch of {self.size} programs with an array of shape {answers[0].shape}")
        walls, cpus, programs = np.array(taken, dtype=np.int64).T
        return Batched(
            found=True,
            answers=np.concatenate(answers),
            wall_ns=walls,
            cpu_ns=cpus,
            programs=programs,
            grown_mb=memory_mb("VmHWM") - before,
        )


def memory_mb(what: str) -> float:
    """The present or largest resident memory of this process, megabytes; NaN where the system does not say."""
    with suppress(OSError, StopIteration):
        line = next(
            line for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines() if line.startswith(what)
        )
        return float(line.split()[1]) / 1024.0
    return float("nan")


def forget_peak() -> None:
    """Let the largest resident memory count from now on, where the system can."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
