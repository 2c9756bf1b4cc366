"""The Gram matrix of columns over a recording, in blocks, filtered by the dynamics if there are any.

GRAM_SAMPLES rows are enough: of a longer recording, every k-th block is used.

If the stage was in motion before its first sample, the modes ring freely at the start of a part,

    r(k) = Σ_i exp(−ζ_i ω_i t) (a_i cos ω_di t + b_i sin ω_di t),   ω_di = ω_i √(1 − ζ_i²),   t = (k − k₀) T

from the first counted sample k₀. The a and b are unknowns of every fit and are eliminated from it: they minimise the
error, and every column of the Jacobian is made orthogonal to the columns of r.

Source: G. Golub and V. Pereyra, "Separable nonlinear least squares: the variable projection method and its
applications", Inverse Problems 19 (2003) R1–R26.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from piezo_model.dynamics import Dynamics
from piezo_model.operator_state import OperatorState, padded_thresholds
from piezo_model.recordings import Recording
from piezo_model.regressors import Regressors
from piezo_model.simulation import behind_amplifier
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Matrix, Vector

CHUNK, GRAM_SAMPLES, STILL, SAME_PERIOD = 2048, 1_000_000, 1e-9, 1e-3
"""Rows of a block, which should fit into the cache; most samples of a Gram matrix; largest range of an operator at
rest, in normalised units; relative tolerance with which two sampling periods are equal."""
DECAYED, ROUNDING = 25.0, 1e-12
"""Time constants after which a mode is at rest; fraction of a column's squares that may be rounding errors."""


def at_period(
    s: ModelStructure, dynamics: Dynamics | None, sample_time: float
) -> tuple[ModelStructure, Dynamics | None]:
    """Structure and dynamics for one of several recordings, at its sampling period in s: without modes that are too
    fast for it, and without a delay if none remains, since each recording has its own delay."""
    if math.isclose(sample_time, s.sample_time, rel_tol=SAME_PERIOD):
        return s, dynamics
    below = dynamics and dynamics.below(sample_time)
    return replace(s, sample_time=sample_time), below if below and below.frequencies_Hz else None


def gram_of(
    recording: Recording,
    counted: Mask,
    s: ModelStructure,
    starts: Sequence[Sequence[OperatorState]],
    unit_y: Vector,
    columns: Callable[..., Matrix],
    unfiltered: Matrix,
    *,
    slopes: bool = False,
    dynamics: Dynamics | None = None,
) -> tuple[Matrix, Mask]:
    """Means of the products of columns over the counted samples of every block, or every k-th one of a long recording,
    and which operators moved (d,).

    ``columns`` is a function of the number of a part, a slice of its samples, and their rows (x, Ξ(x, y)) from each of
    the ``starts``. Its columns are filtered by the dynamics; those of ``unfiltered`` (N, k) are not. With modes, the
    columns are made orthogonal to the ringing from before a part."""
    blocks, r = max(1, math.ceil(recording.length / GRAM_SAMPLES)), padded_thresholds(s)
    lowest, highest = np.full(s.lanes, np.inf), np.full(s.lanes, -np.inf)
    total, count = np.zeros(()), 0.0
    for i, (T, weight, part) in enumerate(zip(recording.periods, recording.part_weights, recording.parts, strict=True)):
        own, lagging = at_period(s, dynamics, T)
        unit_x = s.unit_input(behind_amplifier(own, lagging, recording.x[part], starts[0][i]))
        first_play = np.clip(starts[0][i].play, unit_x[0] - r, unit_x[0] + r)
        lowest = np.minimum(lowest, np.minimum(first_play, unit_x.min() + r))
        highest = np.maximum(highest, np.maximum(first_play, unit_x.max() - r))
        regressors, through = [Regressors(own, start[i], slopes=slopes) for start in starts], None
        ringing, gram = decays(lagging, T, counted[part]), np.zeros(())
        for k, first in enumerate(range(part.start, part.stop, CHUNK)):
            samples = slice(first, min(first + CHUNK, part.stop))
            within = slice(first - part.start, samples.stop - part.start)
            x = unit_x[within]
            if k % blocks:
                through = None
                for rows in regressors:
                    rows.advance(x)
                continue
            J = columns(i, samples, *(rows.rows(x, unit_y[samples]) for rows in regressors))
            if lagging is not None:
                through = through or lagging.stream(own.sample_time)
                J = through(J)
            rings = np.zeros((len(J), ringing.shape[1]))
            rings[: len(ringing[within])] = ringing[within]
            chosen = np.hstack([rings, J, unfiltered[samples]])
            if not counted[samples].all():
                chosen = chosen[counted[samples]]
            gram, count = gram + chosen.T @ chosen, count + weight * len(chosen)
        total = total + weight * (orthogonal(gram, ringing.shape[1]) if ringing.size else gram)
    plays = (highest - lowest > STILL)[: s.n + 1]
    moved = np.ones(s.d, dtype=bool)  # a piece of S⁻¹ that the output never enters has a column of zeros
    moved[s.slices[0]], moved[s.slices[2]] = plays[1:], plays[: s.creep_weights]
    return total / count, moved


def decays(dynamics: Dynamics | None, sample_time: float, counted: Mask) -> Matrix:
    """The columns (M, 2 k) of k modes over the first M samples of a part, after which the modes are at rest."""
    if dynamics is None or not (dynamics.frequencies_Hz and counted.any()):
        return np.zeros((0, 0))
    first, f, zeta = int(np.argmax(counted)), np.array(dynamics.frequencies_Hz), np.array(dynamics.damping)
    poles = 2.0 * math.pi * f * (-zeta + 1j * np.sqrt(1.0 - zeta**2)) * sample_time
    samples = min(counted.size - first, math.ceil(DECAYED / float(-poles.real.max())))
    ringing = np.exp(np.arange(samples)[:, None] * poles)
    return np.vstack([np.zeros((first, 2 * f.size)), np.hstack([ringing.real, ringing.imag])])


def initial_ringing(dynamics: Sequence[Dynamics | None], recording: Recording, error: Vector, counted: Mask) -> Vector:
    """The ringing (N,) that minimises the counted errors (N,), for the dynamics of each part."""
    ringing = np.zeros(error.size)
    for g, T, part in zip(dynamics, recording.periods, recording.parts, strict=True):
        columns = decays(g, T, counted[part])
        rings = slice(part.start, part.start + len(columns))
        if columns.size:
            own = columns[counted[rings]]
            ringing[rings] = columns @ np.linalg.lstsq(own, error[rings][counted[rings]], rcond=None)[0]
    return ringing


def orthogonal(gram: Matrix, first: int) -> Matrix:
    """The Gram matrix of the other columns, made orthogonal to the first ones, without the negative eigenvalues of
    rounding errors; 0 for a column of which only these remain."""
    A, B, C = gram[:first, :first], gram[:first, first:], gram[first:, first:]
    rest = C - B.T @ np.linalg.pinv(A, hermitian=True) @ B
    sizes = np.sqrt(np.where(np.diag(rest) > ROUNDING * np.diag(C), np.diag(rest), 0.0))
    scale = np.outer(sizes, sizes)
    eigenvalues, V = np.linalg.eigh(np.divide(rest, scale, out=np.zeros_like(rest), where=scale > 0.0))
    return np.asarray((V * np.maximum(eigenvalues, 0.0)) @ V.T * scale)
