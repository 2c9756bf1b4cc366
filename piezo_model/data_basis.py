"""The data basis of the identification, accumulated while the samples stream by.

Each sample gives one row (x, Ξ) of the error model (5) (`regressors`), and the cost is the mean square
V(w) = ½ wᵀP w + qᵀw + c with

    P = Σ λ^(N−k) Ξ Ξᵀ / W,   q = Σ λ^(N−k) Ξ x / W,   c = ½ Σ λ^(N−k) x² / W,   W = Σ λ^(N−k)

where λ ≤ 1 forgets (λ = 1: W = N, plain means). Memory does not grow with the recording. Rows are gathered in blocks
of fixed size counted from the last ``clear``, so that the same samples give the same bits in whatever chunks they come.

Source: the paper's equations (3) to (6); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.model import advance
from piezo_model.operator_state import OperatorArrays, OperatorState
from piezo_model.operators import play_step
from piezo_model.regressors import RegressorArrays as RegressorArrays  # rows and their sums are one topic to most users
from piezo_model.regressors import regressor_step as regressor_step
from piezo_model.structure import ModelStructure
from solvers.compiled import inlined, kernel
from solvers.vector8 import load8, padded, splat8, store8

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK = 64
"""Rows gathered before they are added to the Gram matrix, few enough to stay in the first-level cache."""

FILLED, SAMPLES = range(2)
"""Entries of ``BasisArrays.counts``: rows that wait for their block to be full; samples counted since the last clear."""

X_MIN, X_MAX, Y_MIN, Y_MAX = range(4)
"""Entries of ``BasisArrays.span``."""


class BasisArrays(NamedTuple):
    """Everything that the compiled kernels read and write of a data basis."""

    regressors: RegressorArrays
    play: Vector
    creep: Vector
    start_play: Vector
    """States at the first counted sample."""
    start_creep: Vector
    rows: Vector
    gram: Vector
    span: Vector
    counts: Integers
    stride: int
    forgetting: float


@kernel
def _add_rows(p: RegressorArrays, rows: Vector, count: int, stride: int, forgetting: float, gram: Vector) -> None:
    """gram ← λ^N gram + Σ λ^(N−1−k) row_k row_kᵀ, upper triangle, in tiles of four rows by eight columns."""
    if forgetting != 1.0:
        weight = 1.0
        for k in range(count - 1, -1, -1):
            for i in range(k * stride, k * stride + stride, 8):
                store8(rows, i, load8(rows, i) * np.sqrt(weight))
            weight *= forgetting
        for i in range(0, gram.size, 8):
            store8(gram, i, load8(gram, i) * weight)
    for i in range(0, p.width, 4):
        for j in range(i, p.width, 8):
            sum_0 = sum_1 = sum_2 = sum_3 = splat8(0.0)
            for at in range(0, count * stride, stride):
                right = load8(rows, at + j)
                sum_0 = sum_0 + splat8(rows[at + i]) * right
                sum_1 = sum_1 + splat8(rows[at + i + 1]) * right
                sum_2 = sum_2 + splat8(rows[at + i + 2]) * right
                sum_3 = sum_3 + splat8(rows[at + i + 3]) * right
            at = i * stride + j
            store8(gram, at, load8(gram, at) + sum_0)
            store8(gram, at + stride, load8(gram, at + stride) + sum_1)
            store8(gram, at + 2 * stride, load8(gram, at + 2 * stride) + sum_2)
            store8(gram, at + 3 * stride, load8(gram, at + 3 * stride) + sum_3)


@inlined
def count_step(b: BasisArrays, x: float, y: float) -> None:
    """Count one sample in unit amplitudes and move the operator states on; a full block goes into the Gram matrix."""
    if b.counts[SAMPLES] == 0:
        for i in range(b.play.size):
            b.start_play[i] = play_step(x, b.regressors.operators.r[i], b.play[i])
        for i in range(b.creep.size):
            b.start_creep[i] = b.creep[i]
    regressor_step(b.regressors, x, y, b.play, b.creep, b.rows, b.counts[FILLED] * b.stride)
    b.counts[SAMPLES] += 1
    b.counts[FILLED] += 1
    if b.counts[FILLED] == BLOCK:
        _add_rows(b.regressors, b.rows, BLOCK, b.stride, b.forgetting, b.gram)
        b.counts[FILLED] = 0
    b.span[X_MIN], b.span[X_MAX] = min(b.span[X_MIN], x), max(b.span[X_MAX], x)
    b.span[Y_MIN], b.span[Y_MAX] = min(b.span[Y_MIN], y), max(b.span[Y_MAX], y)


@kernel
def _count(b: BasisArrays, x: Vector, y: Vector) -> None:
    for k in range(x.size):
        count_step(b, x[k], y[k])


@kernel
def _advance(p: OperatorArrays, x: Vector, play: Vector, creep: Vector) -> None:
    for k in range(x.size):
        advance(p, x[k], play, creep)


MEMORY = ("play", "creep", "start_play", "start_creep", "rows", "gram", "span", "counts")


class DataBasis:
    """Streaming P, q and c of equation (6).

    Parameters
    ----------
    structure : ModelStructure
    state : OperatorState, optional
        States of the operators before the first sample, at rest at the centre of the range by default. The basis
        works on a copy of its own, ``basis.state``.
    forgetting : float
        λ in (0, 1] per sample; 1 forgets nothing.

    Examples
    --------
    >>> import numpy as np
    >>> structure = ModelStructure.equidistant(n=2, m=1, x_range=(-1, 1), y_range=(-2, 2), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> x = np.sin(np.arange(1000) / 50)
    >>> whole, parts = DataBasis(structure), DataBasis(structure)
    >>> whole.update(x, 2 * x)
    >>> parts.update(x[:333], 2 * x[:333]); parts.update(x[333:], 2 * x[333:])
    >>> bool(np.array_equal(whole.P, parts.P))
    True
    """

    def __init__(self, structure: ModelStructure, state: OperatorState | None = None, forgetting: float = 1.0) -> None:
        if not 0.0 < forgetting <= 1.0:
            raise ValueError(f"forgetting must be above 0 and at most 1, not {forgetting}")
        self.structure = structure
        self.forgetting = forgetting
        self.state = OperatorState.at_rest(structure) if state is None else state.copy()
        self.state.require(structure)
        self._arrays = RegressorArrays.of(structure)
        rows, gram = np.zeros(BLOCK * self._arrays.stride), np.zeros(padded(self._arrays.width) * self._arrays.stride)
        self.arrays = BasisArrays(self._arrays, self.state.play, self.state.creep, self.state.play.copy(),
                                  self.state.creep.copy(), rows, gram, np.zeros(4), np.zeros(2, dtype=np.int64),
                                  self._arrays.stride, forgetting)
        self.clear()

    def clear(self) -> None:
        """Forget P, q and c; the operator states stay, since they follow the actuator for as long as it is powered."""
        self.arrays.gram[:] = 0.0
        self.arrays.counts[:] = 0
        self.arrays.span[:] = np.inf, -np.inf, np.inf, -np.inf

    @property
    def samples(self) -> int:
        """Samples counted since the last ``clear``."""
        return int(self.arrays.counts[SAMPLES])

    def update(self, x: ArrayLike, y: ArrayLike, count: bool = True) -> None:
        """Take the next samples.

        Parameters
        ----------
        x, y : array (N,)
            Input and measured output in the structure's units; any N.
        count : bool
            False moves the operator states on and leaves P, q and c alone, for samples that cannot be trusted.

        Raises
        ------
        ValueError
            For arrays of different length and for values that are not finite; nothing is taken then.
        """
        s = self.structure
        x, y = np.atleast_1d(np.asarray(x, dtype=np.float64)), np.atleast_1d(np.asarray(y, dtype=np.float64))
        if x.ndim != 1 or x.shape != y.shape:
            raise ValueError(f"x and y must be vectors of the same length, not of shapes {x.shape} and {y.shape}")
        for name, values in (("x", x), ("y", y)):
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{name}[{int(np.argmin(np.isfinite(values)))}] is not a finite number")
        if x.size == 0:
            return
        unit_x, unit_y = s.unit_input(x), s.unit_output(y)
        if not count:
            _advance(self._arrays.operators, unit_x, self.state.play, self.state.creep)
            return
        _count(self.arrays, unit_x, unit_y)

    @property
    def total_weight(self) -> float:
        """W: the number of samples, or the sum of their weights with forgetting."""
        if self.forgetting == 1.0:
            return float(self.samples)
        return float(-np.expm1(self.samples * np.log(self.forgetting)) / (1.0 - self.forgetting))

    def _mean_gram(self) -> Matrix:
        if self.samples == 0:
            raise ValueError("the data basis is empty: no sample was counted")
        gram, width, stride, waiting = self.arrays.gram.copy(), self._arrays.width, self._arrays.stride, self.arrays.counts[FILLED]
        if waiting:
            _add_rows(self._arrays, self.arrays.rows.copy(), int(waiting), stride, self.forgetting, gram)
        upper = np.triu(gram.reshape(-1, stride)[:width, :width])
        full: Matrix = (upper + np.triu(upper, 1).T) / self.total_weight
        return full

    @property
    def P(self) -> Matrix:
        """Mean of Ξ Ξᵀ, shape (d, d), weight coordinates, unit amplitudes."""
        return self._mean_gram()[1:, 1:].copy()

    @property
    def q(self) -> Vector:
        """Mean of Ξ x, shape (d,)."""
        return self._mean_gram()[0, 1:].copy()

    @property
    def c(self) -> float:
        """Half the mean of x²."""
        return float(0.5 * self._mean_gram()[0, 0])

    @property
    def excitation(self) -> Excitation:
        """Range of input and output over the counted samples, and which operators moved in it."""
        s, (x_min, x_max, y_min, y_max) = self.structure, (float(value) for value in self.arrays.span)
        # From its state at the first counted sample an operator moves when the input leaves z − r … z + r.
        r, play, creep = self._arrays.operators.r, self.arrays.start_play, self.arrays.start_creep.reshape(-1, s.lanes)
        play_moved = (x_max - r > play) | (x_min + r < play)
        creep_moved = np.any((x_max - r > creep) | (x_min + r < creep), axis=0)
        return Excitation(x_min, x_max, y_min, y_max, tuple(play_moved[1:s.n + 1].tolist()),
                          tuple(creep_moved[:s.creep_weights].tolist()))

    def problem(self, reference: ArrayLike | None = None, **options: float) -> IdentificationProblem:
        """Return the quadratic program (6) of the samples so far; options as of ``IdentificationProblem``."""
        gram = self._mean_gram()
        return IdentificationProblem(self.structure, gram[1:, 1:].copy(), gram[0, 1:].copy(),
                                     float(0.5 * gram[0, 0]), self.excitation, reference, **options)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Copies of everything that changes while samples stream by, waiting rows included."""
        return {name: getattr(self.arrays, name).copy() for name in MEMORY}

    def restore(self, memory: Mapping[str, NDArray[Any]]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave.

        Raises
        ------
        ValueError
            Where an array is missing or of another size; nothing is changed then.
        """
        for name in MEMORY:
            if name not in memory or memory[name].shape != getattr(self.arrays, name).shape:
                raise ValueError(f"the memory of the data basis has no array {name!r} of the size that this structure needs")
        for name in MEMORY:
            getattr(self.arrays, name)[:] = memory[name]
