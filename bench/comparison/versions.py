"""Two versions of a solver, timed interleaved on the same data: which is faster, and by how much.

Each pair of fresh processes, both on one core, solves the problems block by block, in a random order of the two. With
t_a and t_b the median times of an answer in a block, and over the pairs p, the problems u and the blocks r,

    θ_p = median over u of median over r of log(t_b / t_a),   θ = mean of θ_p

and its 95 % interval is Student's, over pairs: memory layout differs between processes, and the blocks of one cannot
show that (T. Mytkowicz et al., "Producing wrong data without doing anything obviously wrong!", ASPLOS 2009).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from bench.comparison.compare import SAME, finding
from bench.messages.task import Progress, RaceError, Task, default_setting
from bench.problems.fresh import FreshData
from bench.problems.protocol import RaceProblem
from bench.processes.solver_child import STANDARD, SolverChild, SolverPool, entry_of_file
from bench.races.measuring import interleave
from bench.races.metrics import relative_gap
from bench.timing import cores
from bench.timing.clock import answers_us
from solvers import Lane

PAIRS = 5
"""Number of pairs of processes."""
BLOCKS, CALLS = 10, 20
"""Blocks of a problem in a pair, and calls of a block."""
NAMES = ("A", "B")
EXACT, FAR = 1e-12, 10.0
"""Relative error of the tightest tier, and the ratio of errors that is no rounding."""


def compare_versions(
    files: Sequence[Path], problems: Sequence[RaceProblem], smallest: float, seed: int, progress: Progress
) -> dict[str, Any]:
    """Compare two files with a solver each on the scaled problems.

    Returns
    -------
    dict
        The ``ratio`` of the times of the second version to those of the first, ``low`` and ``high``, its 95 % interval,
        and the ``finding``; of each version ``us``, the median time of a call on the median problem, and ``gap``, the
        largest relative cost gap or violation of its first answers; ``less_accurate``, whether the second errs by far
        more, and by more than the tightest tier permits.

    Raises
    ------
    RaceError
        A file is not a solver, or a solver fails at a problem.
    """
    entries = [replace(entry_of_file(file), name=name) for file, name in zip(files, NAMES, strict=True)]
    times, gaps = [], []
    with cores.claim() as core:
        for pair in range(PAIRS):
            with SolverPool(entries, STANDARD, core.number) as pool:
                for done, problem in enumerate(problems):
                    progress(f"{problem.name}, pair {pair + 1}", pair * len(problems) + done, PAIRS * len(problems))
                    us, gap = _timed(pool.children, files, problem, f"{seed} {pair} {problem.name}")
                    times.append(us)
                    gaps.append(gap)
    us = np.reshape(times, (PAIRS, len(problems), 2, BLOCKS))
    theta = np.median(np.median(np.log(us[:, :, 1] / us[:, :, 0]), axis=2), axis=1)
    mean, half = float(np.mean(theta)), float(student.ppf(0.975, PAIRS - 1) * np.std(theta, ddof=1) / PAIRS**0.5)
    medians, worst = np.median(np.median(us, axis=3), axis=(0, 1)), np.max(gaps, axis=0)
    return {
        "ratio": math.exp(mean),
        "low": math.exp(mean - half),
        "high": math.exp(mean + half),
        "finding": SAME if abs(mean) + half < math.log(smallest) else finding(mean - half, mean + half, 0.0, smallest),
        "us": medians.tolist(),
        "gap": worst.tolist(),
        "less_accurate": bool(worst[1] > max(EXACT, FAR * worst[0])),
    }


def _timed(
    children: Mapping[tuple[str, Lane], SolverChild], files: Sequence[Path], problem: RaceProblem, seed: str
) -> tuple[np.ndarray, list[float]]:
    """The median time of each version in each block (2, BLOCKS) in µs, and the errors of their first answers."""
    form, times, gaps = problem.forms["scaled"], [], []
    tasks = [
        Task(problem.set_name, problem.name, "scaled", *names, default_setting(child.describe()))
        for names, child in children.items()
    ]
    outcomes = interleave(tasks, children, form, FreshData(form, BLOCKS * CALLS), seed, CALLS)
    for (_, outcome), file in zip(outcomes, files, strict=True):
        if outcome.failure or outcome.x is None or outcome.x.shape != form.qp.q.shape:
            raise RaceError(
                f"{file}: failed at {problem.set_name}/{problem.name}: {outcome.failure} {outcome.message}".rstrip()
            )
        us = answers_us(outcome.times["update"], outcome.times["solve"]).reshape(BLOCKS, CALLS)
        times.append(np.median(us, axis=1).clip(min=1e-3))
        gaps.append(max(relative_gap(form, outcome.x)))
    return np.array(times), gaps
