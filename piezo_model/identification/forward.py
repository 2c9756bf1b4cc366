"""The forward fit: the weights with the smallest error of the output, by Gauss–Newton steps in the box of (6).

    minimise  1/N Σ (y − ŷ)²  over v in the box of (6),    ŷ = S[ H[x] + K[x] + b ]

Since S⁻¹(ŷ) = H[x] + K[x] + b, the row of the error model (5) with ŷ in place of y gives the derivative of the output,
J = Ξ_v(x, ŷ) / s(ŷ) in slope coordinates, where s is the slope of S⁻¹. With e = y − ŷ a step is a program like (6),

    minimise  ½ vᵀP v + qᵀv,    P = JᵀJ / N,    q = −Jᵀe / N − P v₀

and it is halved as long as the cost rises. The program (6) itself is the start: it has y among its regressors, so that
noise of the sensor biases it however long the recording is, and ŷ has none.

With dynamics, ŷ in Ξ and s is the output before them, and the columns of J pass them too; their parameters are further
unknowns, with derivatives by differences of the simulated output.

The slopes dz/dr of the initial states over the thresholds may be unknowns too. A play or a creep state depends on its
own initial state alone, so the derivatives by all of them are the differences of the rows after a nudge to all. Further
columns, such as a drift, are added to the output.

Source: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd edition 2006, section 10.3, for Gauss–Newton.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_model.dynamics import Dynamics
from piezo_model.identification.dynamics_parameters import STEP, Parameters
from piezo_model.identification.error_model import Solving, part_states
from piezo_model.operator_state import OperatorState, padded_thresholds
from piezo_model.recordings import Recording
from piezo_model.regressors import regressor_rows
from piezo_model.simulation import Arrays, all_weights, arrays_of, behind_amplifier, respond
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Matrix, Vector

CHUNK = 16_384
STILL = 1e-9
"""Largest range of an operator at rest, unit amplitudes."""
NUDGE = 1e-6
"""Difference of initial states for their derivatives, unit amplitudes."""
MIN_SLOPE = 1e-3
SHORTEST_STEP = 0.05
CONVERGED = 1e-5
"""Relative decrease of the cost that ends the fit."""
EXACT = 1e-24
"""Cost in unit amplitudes squared at the level of rounding."""


@dataclass(frozen=True)
class Columns:
    """Further unknowns: signals (N, k) that are added to the output in unit amplitudes, and bounds (k,) of their
    weights."""

    signals: Matrix
    low: Vector
    high: Vector

    @classmethod
    def of(cls, signal: Vector, low: float = -np.inf, high: float = np.inf) -> Columns:
        """One column."""
        return cls(signal[:, None], np.array([low]), np.array([high]))

    @classmethod
    def joined(cls, columns: Sequence[Columns]) -> Columns:
        """Columns side by side."""
        signals = np.hstack([each.signals for each in columns])
        return cls(signals, *(np.concatenate([getattr(each, end) for each in columns]) for end in ("low", "high")))


@dataclass(frozen=True)
class ForwardFit:
    """Weights with the smallest error of the output, and the linearisation there."""

    structure: ModelStructure
    state: OperatorState
    """States before the first sample."""
    v: Vector
    """Weights (d,) in slope coordinates."""
    further: Vector
    """Weights of the further columns."""
    cost: float
    """Mean square error of the counted samples, unit amplitudes."""
    static: Vector
    """Output of the model (N,) before the dynamics, in unit amplitudes."""
    y_model: Vector
    """Output of the model (N,) in unit amplitudes, without the further columns."""
    error: Vector
    """y − ŷ (N,) in unit amplitudes, with the further columns."""
    P: Matrix
    """Mean of JᵀJ over (v, further, θ) at the last step."""
    free: Mask
    """Which of these the data determine and no bound holds."""
    dynamics: Dynamics | None = None

    @property
    def weights(self) -> Vector:
        """Weights (d,) in weight coordinates."""
        return self.structure.slope_map @ self.v

    def slopes(self) -> Vector:
        """Slope of S⁻¹ at every modelled output before the dynamics, shape (N,)."""
        return piece_slopes(self.structure, self.v, self.static)


def piece_slopes(s: ModelStructure, v: Vector, unit_y: Vector) -> Vector:
    """Slope of S⁻¹ in the piece of each output, shape (N,)."""
    r = np.array(s.dead_zone_thresholds)
    pieces: Vector = v[s.slices[1]][np.searchsorted(np.delete(r, s.middle), unit_y)]
    return pieces


def initial_slopes(s: ModelStructure, state: OperatorState) -> Vector:
    """Slopes dz/dr of the play states over the thresholds, shape (n,), from −1 to 1."""
    slopes: Vector = np.clip(np.diff(state.play[: s.n + 1]) / np.diff(s.thresholds), -1.0, 1.0)
    return slopes


def state_with_slopes(recording: Recording, s: ModelStructure, slopes: Vector | float) -> OperatorState:
    """States of a memory curve with slopes dz/dr that begins at the first input; creep rests with the plays.

    A play too wide for the drive rests in the middle, where the drive does not move it.
    """
    low, high = s.unit_input(np.array([recording.x.min(), recording.x.max()]))
    first, half = float(s.unit_input(recording.x[:1])[0]), 0.5 * (high - low)
    r, play = padded_thresholds(s), np.full(s.lanes, first)
    play[1 : s.n + 1] += np.cumsum(np.diff(s.thresholds) * slopes)
    play = np.where(r >= half, 0.5 * (low + high), play)
    return OperatorState(play, np.tile(play, len(s.creep_rates)))


def simulate(
    s: ModelStructure, arrays: Arrays, recording: Recording, state: OperatorState, dynamics: Dynamics | None = None
) -> Vector:
    """Output (N,) of a model in its unit, from the given states, and settled at each later start of a part."""
    return responses(s, arrays, recording, state, dynamics)[1]


def responses(
    s: ModelStructure, arrays: Arrays, recording: Recording, state: OperatorState, dynamics: Dynamics | None
) -> tuple[Vector, Vector]:
    """Outputs (N,) before and behind the dynamics, as of `simulate`."""
    parts = [respond(s, arrays, dynamics, recording.x[part], start) for part, start in part_states(recording, s, state)]
    before, behind = zip(*parts, strict=True)
    return np.concatenate(before), np.concatenate(behind)


def fit_forward(
    recording: Recording,
    counted: Mask,
    s: ModelStructure,
    state: OperatorState,
    v: Vector,
    solving: Solving,
    *,
    steps: int = 6,
    free_start: bool = False,
    weights_known: bool = False,
    further: Columns | None = None,
    creep_limits: Vector | None = None,
    parameters: Parameters | None = None,
) -> ForwardFit:
    """Minimise the error of the output over weights and other unknowns.

    Parameters
    ----------
    recording : Recording
        In the units of the structure.
    counted : array (N,) of bool
    state : OperatorState
        States before the first sample; those of the plays are where ``free_start`` begins.
    v : array (d,)
        Weights to begin with, slope coordinates.
    steps : int
        Most steps.
    weights_known : bool
        Whether the weights stay as they are.
    further : Columns, optional
    creep_limits : array (n + 1,), optional
        Upper bounds of the creep weights.
    parameters : Parameters, optional
        The dynamics, with those of their parameters that are unknowns.

    Returns
    -------
    ForwardFit
    """
    n, d, k = s.n * free_start, s.d, 0 if further is None else further.low.size
    ends = (np.zeros(0), np.zeros(0)) if parameters is None else parameters.bounds
    low = np.concatenate([s.lower_bounds(MIN_SLOPE), -np.ones(n), np.full(k, -np.inf), ends[0]])
    high = np.concatenate([np.full(d, np.inf), np.ones(n), np.full(k, np.inf), ends[1]])
    if further is not None:
        low[d + n : d + n + k], high[d + n : d + n + k] = further.low, further.high
    if creep_limits is not None:
        high[s.slices[2]] = creep_limits
    theta = np.zeros(0) if parameters is None else parameters.vector
    z = np.concatenate([v, initial_slopes(s, state)[:n], np.zeros(k), theta])
    z = np.where(np.isfinite(low) & np.isfinite(high), np.clip(z, low, high), np.maximum(np.minimum(z, high), low))
    unit_y = s.unit_output(recording.y)

    def trial(z: Vector) -> Trial:
        solving.passes += 1
        begun = state_with_slopes(recording, s, z[d : d + n]) if n else state
        arrays = arrays_of(s, all_weights(s, s.slope_map @ z[:d]))
        dynamics = None if parameters is None else parameters.at(z[d + n + k :])
        static, y_model = (s.unit_output(y) for y in responses(s, arrays, recording, begun, dynamics))
        error = unit_y - y_model - (0.0 if further is None else further.signals @ z[d + n : d + n + k])
        return Trial(z, begun, dynamics, static, y_model, error, float(np.mean(np.square(error[counted]))))

    known = np.zeros(z.size, dtype=bool)
    known[:d] = weights_known
    best = trial(z)
    P, free = np.eye(z.size), ~known
    for _ in range(steps):
        solving.passes += 1
        moves = []
        for i in range(d + n + k, z.size):
            step = STEP if best.z[i] + STEP <= high[i] else -STEP
            other = trial(best.z + step * (np.arange(z.size) == i))
            moves.append(Columns.of((other.y_model - best.y_model) / step))
        beside = [*([] if further is None else [further]), *moves]
        gram, moved = _gram(recording, counted, s, best, n, Columns.joined(beside) if beside else None)
        P, Je = gram[:-1, :-1], gram[:-1, -1]
        determined = (np.diag(P) > 0.0) & ~known
        determined[:d] &= moved
        z = best.z
        free = determined & (z > low) & (z < high)
        if not determined.any():
            break
        at = np.ix_(determined, determined)
        target = z.copy()
        target[determined] = solving.minimise(
            P[at], -Je[determined] - P[at] @ z[determined], low[determined], high[determined], z[determined]
        )
        step = 1.0
        while True:
            found = trial(z + step * (target - z))
            if found.cost <= best.cost or step < SHORTEST_STEP:
                break
            step *= 0.5
        gain = best.cost - found.cost
        if gain > 0.0:
            best = found
            free = determined & (best.z > low) & (best.z < high)
        if gain <= CONVERGED * best.cost or best.cost < EXACT:
            break
    kept: NDArray[np.int64] = np.r_[np.arange(d), np.arange(d + n, z.size)]
    return ForwardFit(
        s,
        best.state,
        best.z[:d],
        best.z[d + n : d + n + k],
        best.cost,
        best.static,
        best.y_model,
        best.error,
        P[np.ix_(kept, kept)],
        free[kept],
        best.dynamics,
    )


@dataclass(frozen=True)
class Trial:
    """The model of all unknowns ``z``, simulated, in unit amplitudes."""

    z: Vector
    state: OperatorState
    dynamics: Dynamics | None
    static: Vector
    y_model: Vector
    error: Vector
    cost: float


def _nudged(s: ModelStructure, state: OperatorState) -> OperatorState:
    """The states with those of all thresholds above zero nudged towards the input."""
    nudged, nudge = state.copy(), _nudges(s, state)
    nudged.play[1 : s.n + 1] += nudge
    nudged.creep.reshape(-1, s.lanes)[:, 1 : s.n + 1] += nudge
    return nudged


def _nudges(s: ModelStructure, state: OperatorState) -> Vector:
    """Nudge of each threshold above zero, shape (n,)."""
    nudges: Vector = np.where(state.play[1 : s.n + 1] > state.play[0], -NUDGE, NUDGE)
    return nudges


def _gram(
    recording: Recording,
    counted: Mask,
    s: ModelStructure,
    at: Trial,
    free_slopes: int,
    further: Columns | None,
) -> tuple[Matrix, Mask]:
    """Means of the products of the columns of J and e over the counted samples, and which operators moved (d,)."""
    v, y, slopes = at.z[: s.d], s.y_centre + s.y_scale * at.static, piece_slopes(s, at.z[: s.d], at.static)
    width = s.d + free_slopes + (0 if further is None else further.low.size) + 1
    sums = np.zeros((width, width))
    lowest, highest = np.full(s.d, np.inf), np.full(s.d, -np.inf)
    steps = np.tril(np.ones((s.n, s.n))) * np.diff(s.thresholds)  # dz_i / d(slope j)
    for part, start in part_states(recording, s, at.state):
        nudged, nudges = _nudged(s, start), _nudges(s, start)
        x = behind_amplifier(s, at.dynamics, recording.x[part], start)
        through = (lambda rows: rows) if at.dynamics is None else at.dynamics.stream(s.sample_time)
        for first in range(part.start, part.stop, CHUNK):
            samples = slice(first, min(first + CHUNK, part.stop))
            own = slice(samples.start - part.start, samples.stop - part.start)
            rows = regressor_rows(s, start, x[own], y[samples], slopes=True)[:, 1:]
            lowest, highest = np.minimum(lowest, rows.min(axis=0)), np.maximum(highest, rows.max(axis=0))
            columns = [rows]
            if free_slopes and part.start == 0:
                other = regressor_rows(s, nudged, x[own], y[samples], slopes=True)[:, 1:]
                change = (other - rows) * v
                creeps = change[:, s.slices[2]][:, 1:] if s.creep_rates else 0.0
                columns.append((change[:, : s.n] + creeps) / nudges @ steps)
            elif free_slopes:
                columns.append(np.zeros((len(rows), free_slopes)))
            J = through(np.hstack(columns) / slopes[samples, None])
            J = np.hstack([J, *([] if further is None else [further.signals[samples]]), at.error[samples, None]])
            J = J[counted[samples]]
            sums += J.T @ J
    moved = highest - lowest > STILL
    moved[s.slices[1]] = True  # a piece of S⁻¹ that the output never enters has a column of zeros
    if s.offset:
        moved[-1] = True
    return sums / np.count_nonzero(counted), moved
