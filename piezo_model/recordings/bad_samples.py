"""Isolated bad samples: one value far from both of its neighbours, to which the other signal shows nothing.

Real jumps of a drive stay, come again, or move the output; a bad sample does none of this. The drive there is replaced
before the operators see it, and the sample is not counted.
"""

import numpy as np

from piezo_model.recordings.rows import LEAST_ROWS, Rows
from solvers.arrays import Index, Vector

MOST_BAD = 2
"""Most bad samples of a signal: more of them are a property of the signal."""
UNLIKE = 10.0
"""Smallest ratio of the steps to and from a bad sample to all others."""
RETURN = 0.2
"""Largest distance between the two neighbours, as a share of the step."""
ANSWER = 4.0
"""Smallest ratio of the other signal's steps next to a jump, to its steps elsewhere, that answers it."""
REACH = 3
"""Samples after a jump within which the other signal answers."""


def replace_bad_samples(rows: Rows) -> None:
    """Name isolated bad samples and draw straight lines over them."""
    if rows.length < LEAST_ROWS:
        return
    for k, (label, values) in enumerate(zip(rows.labels, list(rows.signals), strict=True)):
        bad = np.zeros(rows.length, dtype=bool)
        others = [signal for signal in rows.signals if signal is not rows.signals[k]]
        for row in _isolated(values, _steps(rows, values)):
            bad[row] = not any(_answers(_steps(rows, other), row) for other in others)
        for row in np.flatnonzero(bad).tolist():
            beside = " and ".join(f"{values[j]:.6g}" for j in (row - 1, row + 1) if 0 <= j < rows.length)
            found = f"{label} is {values[row]:.6g} in {rows.where(row)} beside {beside}"
            rows.repairs.append(f"{found}, an isolated bad sample, which is not counted")
        if bad.any():
            rows.replace(k, bad)


def _steps(rows: Rows, values: Vector) -> Vector:
    """Sizes of the steps between samples, those between parts as 0."""
    steps = np.diff(values)
    np.abs(steps, out=steps)
    steps[np.array(rows.starts[1:], dtype=int) - 1] = 0.0
    return steps


def _largest(steps: Vector, rank: int) -> float:
    """The step of some rank, the largest being of rank 1; found part by part, since a copy of all needs memory."""
    parts = np.array_split(steps, 1 + steps.size // 2**20)
    return float(np.sort(np.concatenate([np.partition(part, -min(rank, part.size))[-rank:] for part in parts]))[-rank])


def _isolated(values: Vector, steps: Vector) -> Index:
    """Samples far from both neighbours, or from the one at an end; none if more than ``MOST_BAD``."""
    least = UNLIKE * _largest(steps, 2 * MOST_BAD + 2)  # two steps for each bad sample, and one may be real
    large = np.flatnonzero(steps > least)
    if not large.size or least == 0.0:
        return np.empty(0, dtype=int)
    pairs = large[:-1][np.diff(large) == 1]
    inside = pairs[np.abs(values[pairs + 2] - values[pairs]) < RETURN * steps[pairs]] + 1
    ends = [row for row, step in ((0, 0), (values.size - 1, steps.size - 1)) if step in large and row not in inside]
    ends = [row for row in ends if not {row - 1, row + 1} & {*inside.tolist()}]
    found = np.unique([*inside.tolist(), *ends]).astype(int)
    return found if found.size <= MOST_BAD else found[:0]


def _answers(steps: Vector, row: int) -> bool:
    """Whether a signal jumps where the other one does."""
    near = steps[max(row - 1, 0) : row + REACH]
    return bool(near.size and near.max() > ANSWER * _largest(steps, 2 * MOST_BAD + 2))
