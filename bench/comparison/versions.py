"""Two versions of a solver, timed interleaved on the same data: which is faster, and by how much.

Each pair of fresh processes, both on one core, solves the problems block by block, in a random order of the two. With
t_a and t_b the median times of a call in a block, and over the pairs p, the problems u and the blocks r,

    θ_p = median over u of median over r of log(t_b / t_a),   θ = mean of θ_p

and its 95 % interval is Student's, over pairs: memory layout differs between processes, and the blocks of one cannot
show that (T. Mytkowicz et al., "Producing wrong data without doing anything obviously wrong!", ASPLOS 2009).
"""

import math
import random
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from bench.comparison.compare import CANNOT_TELL, FASTER, SAME, SLOWER
from bench.messages.progress import Progress, silent
from bench.messages.race_error import RaceError
from bench.messages.task import Outcome, Setting, Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import RaceProblem
from bench.processes.forked_child import warm_up
from bench.processes.solver_child import SolverChild, entry_of_file
from bench.races.metrics import relative_gap
from bench.races.oneshot.measuring import BlockError, run_block, set_up
from bench.timing import cores
from solvers.protocol import setting_text
from solvers.registry import Entry, from_file

PAIRS = 5
"""Number of pairs of processes."""
BLOCKS, CALLS = 10, 20
"""Blocks of a problem in a pair, after one that is not counted, and calls of a block."""
NAMES = ("A", "B")


@dataclass(frozen=True)
class VersionComparison:
    """The ratio of the times of version B to those of version A."""

    ratio: float
    low: float
    high: float
    """95 % interval."""
    finding: str
    us: tuple[float, float]
    """Median time of a call of each version on the median problem."""
    gap: tuple[float, float]
    """Largest relative cost gap or violation of the first answers of each."""


def compare_versions(
    files: Sequence[Path], problems: Sequence[RaceProblem], smallest: float, seed: int, progress: Progress = silent
) -> VersionComparison:
    """Compare two files with a solver each on the scaled problems.

    Raises
    ------
    RaceError
        A file is not a solver, or a solver fails at a problem.
    """
    entries = [replace(entry_of_file(file, from_file), name=name) for file, name in zip(files, NAMES, strict=True)]
    chance, theta, us, gaps = random.Random(seed), [], [], []
    warm_up(entries)
    with cores.claim() as core:
        for pair in range(PAIRS):
            with ExitStack() as stack:
                children = [stack.enter_context(SolverChild(entry, core=core.number)) for entry in entries]
                ratios = []
                for done, problem in enumerate(problems):
                    progress(f"{problem.name}, pair {pair + 1}", pair * len(problems) + done, PAIRS * len(problems))
                    times, gap = _timed(children, entries, files, problem, chance)
                    ratios.append(float(np.median(np.log(times[1] / times[0]))))
                    us.append(np.median(times, axis=1))
                    gaps.append(gap)
                theta.append(float(np.median(ratios)))
    mean, half = float(np.mean(theta)), float(student.ppf(0.975, PAIRS - 1) * np.std(theta, ddof=1) / PAIRS**0.5)
    first, second = np.median(us, axis=0)
    worst = np.max(gaps, axis=0)
    return VersionComparison(
        math.exp(mean),
        math.exp(mean - half),
        math.exp(mean + half),
        _finding(mean - half, mean + half, math.log(smallest)),
        (float(first), float(second)),
        (float(worst[0]), float(worst[1])),
    )


def _finding(low: float, high: float, matters: float) -> str:
    if max(-low, high) < matters:
        return SAME
    if low > 0.0 or high < 0.0:
        return SLOWER if low > 0.0 else FASTER
    return CANNOT_TELL


def _timed(
    children: Sequence[SolverChild],
    entries: Sequence[Entry],
    files: Sequence[Path],
    problem: RaceProblem,
    chance: random.Random,
) -> tuple[np.ndarray, list[float]]:
    """The median time of each version in each block (2, BLOCKS) in µs, and the errors of their first answers."""
    form = problem.forms["scaled"]
    fresh = FreshData(form, (BLOCKS + 1) * CALLS)
    tasks, gaps, times = [], [], np.zeros((2, BLOCKS + 1))
    for child, entry, file in zip(children, entries, files, strict=True):
        setting = Setting(setting_text(child.describe().defaults))
        task = Task(problem.set_name, problem.name, "scaled", entry.name, entry.lane, setting)
        outcome = set_up(child, task, form)
        if outcome.failure or outcome.x is None:
            raise _failed(file, problem, outcome)
        tasks.append(task)
        gaps.append(max(relative_gap(form, outcome.x)))
    for at in range(BLOCKS + 1):
        data = fresh.block(at * CALLS, (at + 1) * CALLS)
        for k in chance.sample((0, 1), 2):
            try:
                block = run_block(children[k], tasks[k], *data)
            except BlockError as error:
                raise _failed(files[k], problem, *error.args) from None
            times[k, at] = np.median(block.calls_ns) / 1e3
    return np.maximum(times[:, 1:], 1e-3), gaps


def _failed(file: Path, problem: RaceProblem, outcome: Outcome) -> RaceError:
    return RaceError(
        f"{file}: failed at {problem.set_name}/{problem.name}: {outcome.failure} {outcome.message}".strip()
    )
