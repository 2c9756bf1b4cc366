"""The data basis of the identification, accumulated while the samples stream by.

Each sample gives one row of the error model (5), linear in the unknowns w:

    E(k) = wᵀΞ(k) + x(k),   Ξ = (H_r1[x] … H_rn[x],  −S_r'[y] …,  K_r0[x] … K_rn[x],  [1]) in unit amplitudes

and the cost is the mean square V(w) = ½ wᵀP w + qᵀw + c with

    P = Σ λ^(N−k) Ξ Ξᵀ / W,   q = Σ λ^(N−k) Ξ x / W,   c = ½ Σ λ^(N−k) x² / W,   W = Σ λ^(N−k)

where λ ≤ 1 forgets (λ = 1: W = N, plain means). Memory does not grow with the recording. Rows are gathered in blocks
of fixed size counted from the last ``clear``, so that the same samples give the same bits in whatever chunks they come.

Source: the paper's equations (3) to (6); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model.identification_problem import Coordinates, Excitation, IdentificationProblem
from piezo_model.model import advance
from piezo_model.operator_state import OperatorArrays, OperatorState, SuperpositionArrays
from piezo_model.operators import creep_step, dead_zone_step, play, play_step
from piezo_model.structure import ModelStructure
from solvers.compiled import inlined, kernel
from solvers.vector8 import LANES, load8, padded, splat8, store8

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BLOCK = 64
"""Rows gathered before they are added to the Gram matrix, few enough to stay in the first-level cache."""


class RegressorArrays(NamedTuple):
    """Parameters of the regressor row as the compiled kernels take them."""

    operators: OperatorArrays
    dead_zones: SuperpositionArrays
    outer: SuperpositionArrays
    """Dead zones to be taken off: the next ones outwards for slope coordinates, nothing for weights."""
    n: int
    width: int
    """d + 1."""
    offset: bool

    @classmethod
    def of(cls, s: ModelStructure, coordinates: Coordinates = "weight") -> RegressorArrays:
        """Parameters of a structure; in slope coordinates the row is that of v = T⁻¹ w, Ξ_v = Tᵀ Ξ."""
        r_S = np.array(s.dead_zone_thresholds)
        zones = SuperpositionArrays.of(np.ones_like(r_S), r_S)
        outer = SuperpositionArrays(np.full_like(zones.low, -np.inf), np.full_like(zones.high, np.inf), zones.w)
        if coordinates == "slope":
            low, high, middle, last = zones.low, zones.high, s.middle, s.dead_zones - 1
            outer.low[1:middle], outer.high[1:middle] = low[:max(middle - 1, 0)], high[:max(middle - 1, 0)]
            outer.low[middle + 1:last], outer.high[middle + 1:last] = low[middle + 2:last + 1], high[middle + 2:last + 1]
            # The piece around zero ends at the next threshold on both sides.
            outer.low[middle] = low[middle - 1] if middle > 0 else -np.inf
            outer.high[middle] = high[middle + 1] if middle < last else np.inf
        return cls(OperatorArrays.of(s), zones, outer, s.n, s.d + 1, s.offset)

    @property
    def stride(self) -> int:
        """Length of a row in memory: blocks of eight are written and read beyond the last column."""
        return padded(self.width + LANES)


@inlined
def regressor_step(p: RegressorArrays, x: float, y: float, play: Vector, creep: Vector, rows: Vector, at: int) -> None:
    """Write the row (x, Ξ) of one sample to ``rows[at:]`` and move the operator states on.

    Blocks are written from left to right, so that each one overwrites the padding of the one before it.
    """
    lanes = p.operators.r.size
    vx, vy = splat8(x), splat8(y)
    for i in range(0, lanes, 8):
        play_i = play_step(vx, load8(p.operators.r, i), load8(play, i))
        store8(play, i, play_i)
        store8(rows, at + i, play_i)
    column = at + p.n + 1
    for i in range(0, p.dead_zones.w.size, 8):
        inner = dead_zone_step(vy, load8(p.dead_zones.low, i), load8(p.dead_zones.high, i))
        store8(rows, column + i, dead_zone_step(vy, load8(p.outer.low, i), load8(p.outer.high, i)) - inner)
    if p.operators.rates > 0:
        column = at + p.width - p.offset - p.n - 1
        for i in range(0, lanes, 8):
            r, total = load8(p.operators.r, i), splat8(0.0)
            for j in range(p.operators.rates):
                z = load8(creep, j * lanes + i)
                total = total + z
                store8(creep, j * lanes + i, creep_step(vx, r, load8(p.operators.a, j * lanes + i), z))
            store8(rows, column + i, total)
    if p.offset:
        rows[at + p.width - 1] = 1.0


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


@kernel
def _gather(p: RegressorArrays, x: Vector, y: Vector, play: Vector, creep: Vector, rows: Vector, filled: int,
            stride: int, forgetting: float, gram: Vector) -> int:
    """Turn samples into rows; every full block goes into the Gram matrix. Returns the rows left waiting."""
    for k in range(x.size):
        regressor_step(p, x[k], y[k], play, creep, rows, filled * stride)
        filled += 1
        if filled == BLOCK:
            _add_rows(p, rows, BLOCK, stride, forgetting, gram)
            filled = 0
    return filled


@kernel
def regressors(p: RegressorArrays, x: Vector, y: Vector, play: Vector, creep: Vector, rows: Vector, stride: int) -> None:
    """Write the rows (x, Ξ) of samples in unit amplitudes, ``stride`` numbers each, and move the operator states on."""
    for k in range(x.size):
        regressor_step(p, x[k], y[k], play, creep, rows, k * stride)


@kernel
def _advance(p: OperatorArrays, x: Vector, play: Vector, creep: Vector) -> None:
    for k in range(x.size):
        advance(p, x[k], play, creep)


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
        self._rows = np.zeros(BLOCK * self._arrays.stride)
        self.clear()

    def clear(self) -> None:
        """Forget P, q and c; the operator states stay, since they follow the actuator for as long as it is powered."""
        self._gram = np.zeros(padded(self._arrays.width) * self._arrays.stride)
        self._filled = 0
        self.samples = 0
        self._span = np.array([np.inf, -np.inf, np.inf, -np.inf])
        self._start = self.state

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
        if self.samples == 0:
            self._start = self.state.copy()
            self._start.play = play(unit_x[:1], self._arrays.operators.r, self.state.play)[1]
        self._filled = _gather(self._arrays, unit_x, unit_y, self.state.play, self.state.creep, self._rows,
                               self._filled, self._arrays.stride, self.forgetting, self._gram)
        self.samples += x.size
        span = self._span
        span[:] = (min(span[0], unit_x.min()), max(span[1], unit_x.max()),
                   min(span[2], unit_y.min()), max(span[3], unit_y.max()))

    @property
    def total_weight(self) -> float:
        """W: the number of samples, or the sum of their weights with forgetting."""
        if self.forgetting == 1.0:
            return float(self.samples)
        return float(-np.expm1(self.samples * np.log(self.forgetting)) / (1.0 - self.forgetting))

    def _mean_gram(self) -> Matrix:
        if self.samples == 0:
            raise ValueError("the data basis is empty: no sample was counted")
        gram, width, stride = self._gram.copy(), self._arrays.width, self._arrays.stride
        if self._filled:
            _add_rows(self._arrays, self._rows.copy(), self._filled, stride, self.forgetting, gram)
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
        s, (x_min, x_max, y_min, y_max) = self.structure, (float(value) for value in self._span)
        # From its state at the first counted sample an operator moves when the input leaves z − r … z + r.
        r, creep = self._arrays.operators.r, self._start.creep.reshape(-1, s.lanes)
        play_moved = (x_max - r > self._start.play) | (x_min + r < self._start.play)
        creep_moved = np.any((x_max - r > creep) | (x_min + r < creep), axis=0)
        return Excitation(x_min, x_max, y_min, y_max, tuple(play_moved[1:s.n + 1].tolist()),
                          tuple(creep_moved[:s.creep_weights].tolist()))

    def problem(self, reference: ArrayLike | None = None, **options: float) -> IdentificationProblem:
        """Return the quadratic program (6) of the samples so far; options as of ``IdentificationProblem``."""
        gram = self._mean_gram()
        return IdentificationProblem(self.structure, gram[1:, 1:].copy(), gram[0, 1:].copy(),
                                     float(0.5 * gram[0, 0]), self.excitation, reference, **options)
