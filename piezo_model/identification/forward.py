"""The forward fit: the weights with the smallest output error, by Gauss–Newton steps in the box of (6).

    minimise  1/N Σ (y − ŷ)²  over v in the box of (6),    ŷ = S[ H[x] + K[x] + b ]

Since S⁻¹(ŷ) = H[x] + K[x] + b, the row of the error model (5) with ŷ in place of y gives the derivative of the output,
J = Ξ_v(x, ŷ) / s(ŷ) in slope coordinates, where s is the slope of S⁻¹. With e = y − ŷ a step is a program like (6),

    minimise  ½ vᵀP v + qᵀv,    P = JᵀJ / N,    q = −Jᵀe / N − P v₀

which is halved as long as the cost rises. The solution of program (6) itself is the starting point. It is biased by the
sensor's noise, however long the recording is, since y is among its regressors; ŷ has no noise.

With dynamics, ŷ in Ξ and s is the output before them, and the columns of J are filtered by them too. Their parameters
are further unknowns, with finite differences of the simulated output as derivatives. The ringing of the modes from
before the recording is part of ŷ (`gram_matrix`).

The initial states of a part are a memory curve: the play states z over their thresholds r begin at the input, z(0) = x,
with |dz/dr| ≤ 1, and hold what remains of the past. Its slopes may be unknowns too. A play or creep state depends only
on its own initial state, so one perturbation of all states gives the derivatives with respect to each of them.
Further columns, such as a drift, are added to the output.

ŷ and the cost use all samples; the Gram matrix needs fewer (`gram_matrix`).

Sources: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd edition 2006, section 10.3, for Gauss–Newton;
M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3, for the memory curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from piezo_model.dynamics import Dynamics
from piezo_model.identification.autocorrelation import autocorrelation_time, independent_samples, inverse_over
from piezo_model.identification.dynamics_parameters import STEP, Parameters
from piezo_model.identification.error_model import ProgramSolver, States
from piezo_model.identification.gram_matrix import at_period, gram_of, initial_ringing
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.operator_state import OperatorState, padded_thresholds
from piezo_model.recordings import Recording
from piezo_model.simulation import (
    all_weights,
    arrays_of,
    before_dynamics,
    behind_dynamics,
)
from piezo_model.structure import ModelStructure
from solvers.arrays import Index, Mask, Matrix, Vector

GAIN, NUDGE = 0.1, 1e-6
"""Largest gain required of further unknowns, relative to the cost; perturbation of the initial states for their
derivatives, normalised units."""
MIN_SLOPE, MAX_SLOPE, SHORTEST_STEP, CONVERGED = 1e-3, 1e6, 0.002, 1e-5
"""Bounds of the slopes of S⁻¹ (a sum of weights above the upper one is lost in rounding); shortest fraction of a step;
relative decrease of the cost below which the fit ends."""
EXACT, AT_BOUND = 1e-20, 1e-7
"""Squared rounding error in normalised units, which is added to every cost, so that neither a ratio nor a comparison of
costs depends on rounding; largest distance of an unknown from a bound at which the bound is active."""


@dataclass(frozen=True)
class Box:
    """Bounds (k,) of unknowns; every trial point is projected into those of all."""

    lb: Vector
    ub: Vector

    def project(self, z: Vector) -> Vector:
        """The point of the box nearest to z (k,)."""
        return np.clip(z, self.lb, self.ub)

    def step(self, z: Vector, direction: Vector) -> tuple[Vector, float]:
        """A point of the box near z (k,) for a finite difference, and the step along the direction (k,) that leads
        there: at most STEP, and negative if a bound is too near."""
        along, size = np.flatnonzero(direction), STEP / np.abs(direction).max()
        ends = np.array([self.ub - z, self.lb - z])[:, along] / direction[along]
        up, down = np.min(np.max(ends, axis=0)), np.max(np.min(ends, axis=0))
        step = float(min(size, up) if up >= min(size, -down) else max(-size, down))
        return z + step * direction, step

    def inactive(self, z: Vector) -> Mask:
        """Which unknowns of z (k,) are at no bound."""
        return np.asarray((z > self.lb + AT_BOUND) & (z < self.ub - AT_BOUND))


@dataclass(frozen=True)
class Columns(Box):
    """Further unknowns, the weights of signals (N, k) that are added to the output in normalised units."""

    signals: Matrix

    @classmethod
    def of(cls, signals: Vector | Matrix, lb: float = -np.inf, ub: float = np.inf) -> Columns:
        """Columns of signals (N,) or (N, k) whose weights have the same bounds."""
        columns = np.column_stack([signals])
        return cls(np.full(columns.shape[1], lb), np.full(columns.shape[1], ub), columns)

    @classmethod
    def none(cls, samples: int) -> Columns:
        """No columns, for a number of samples."""
        return cls.of(np.zeros((samples, 0)))

    def append(self, others: Columns) -> Columns:
        """These columns, followed by others."""
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return Columns(*(np.concatenate(pair, axis=-1) for pair in pairs))


@dataclass(frozen=True)
class Trial:
    """The model of all unknowns ``z`` = (v, initial slopes, further, θ), simulated, in normalised units."""

    z: Vector
    states: States
    """States before the first sample of each part."""
    dynamics: Dynamics | None
    static: Vector
    """Output of the model (N,) before the dynamics."""
    y_model: Vector
    """Output of the model (N,), with the ringing from before the recording but without the further columns."""
    ringing: Vector
    """Ringing from before the recording (N,)."""
    error: Vector
    """y − ŷ (N,), with the further columns in ŷ."""
    cost: float
    """Mean square error of the counted samples, plus EXACT."""


@dataclass(frozen=True)
class ForwardFit(Trial):
    """Weights with the smallest output error, and the linearisation there."""

    structure: ModelStructure
    further: Vector
    """Weights of the further columns."""
    counted: Mask
    recording: Recording
    P: Matrix
    """Mean of JᵀJ over (v, further, θ), at the start of the last step."""
    free: Mask
    """Which of these unknowns the data determine and no bound holds."""
    parameters: Parameters | None
    """The dynamics, and which of their parameters were unknowns."""
    derivative: Callable[[Vector], Vector]
    """Derivative of the output (N,) along a direction of (v, further, θ), 0 for unknowns at a bound."""
    P_here: Callable[[], Matrix]
    """P at the solution, which may differ from ``P`` for unknowns that the data barely determine."""

    @property
    def v(self) -> Vector:
        """Weights (d,) in slope coordinates."""
        return self.z[: self.structure.d]

    @property
    def weights(self) -> Vector:
        """Weights (d,) in weight coordinates."""
        return self.structure.slope_map @ self.v

    @property
    def rms(self) -> float:
        """Root of the cost, output unit."""
        return abs(self.structure.y_scale) * math.sqrt(self.cost)

    @property
    def errors(self) -> list[Vector]:
        """Errors of the counted samples of each part, in normalised units; their mean square is the cost."""
        scaled = self.error * _error_scale(self.recording, self.counted)
        return [scaled[part][self.counted[part]] for part in self.recording.parts]

    @cached_property
    def autocorrelation_time(self) -> float:
        """Autocorrelation time of the errors; for several recordings one large enough that none of them counts as more
        independent samples than it has."""
        errors, owners = self.errors, np.array(self.recording.owners)
        samples = sum(error.size for error in errors) / len(set(owners.tolist()))
        members = ([errors[i] for i in np.flatnonzero(owners == owner)] for owner in np.unique(owners))
        return max(autocorrelation_time(own) * samples / sum(error.size for error in own) for own in members)

    @cached_property
    def independent(self) -> float:
        """Number of independent samples in the error."""
        return independent_samples(self.errors)

    def covariance_over(self, free: Mask) -> Matrix:
        """Covariance of (v, further, θ), or the one that they would have with other free unknowns; 0 for those that are
        not free."""
        return self.cost * self.autocorrelation_time / np.count_nonzero(self.counted) * inverse_over(self.P, free)

    def improved_by(self, other: ForwardFit, unknowns: int) -> bool:
        """True if another fit is better by more than its further unknowns are worth."""
        independent = self.independent
        return other.cost < (1.0 - min(GAIN, unknowns * math.log(independent) / independent)) * self.cost


def piece_slopes(s: ModelStructure, v: Vector, unit_y: Vector) -> Vector:
    """Slope of S⁻¹ in the piece of each output, shape (N,)."""
    return np.asarray(v[s.slices[1]][np.searchsorted(np.delete(s.dead_zone_thresholds, s.middle), unit_y)])


def state_with_slopes(x: Vector, s: ModelStructure, slopes: Vector | float) -> OperatorState:
    """States of a memory curve with slopes dz/dr that begins at the first of the inputs x (N,); creep rests with the
    plays.

    A play too wide for the drive rests in the middle of its range, where the drive does not move it.
    """
    low, high = s.unit_input(np.array([x.min(), x.max()]))
    first, half = float(s.unit_input(x[:1])[0]), 0.5 * (high - low)
    r, play = padded_thresholds(s), np.full(s.lanes, first)
    play[1 : s.n + 1] += np.cumsum(np.diff(s.thresholds) * slopes)
    play = np.where(r >= half, 0.5 * (low + high), play)
    return OperatorState(play, np.tile(play, len(s.creep_rates)))


def _by_parts(
    recording: Recording, signal: Vector, states: States, respond: Callable[[float, Vector, OperatorState], Vector]
) -> Vector:
    """A response to a signal (N,), from the sampling period of each part of a recording and the states before it."""
    return np.concatenate(
        [
            respond(T, signal[part], state)
            for T, part, state in zip(recording.periods, recording.parts, states, strict=True)
        ]
    )


def _error_scale(recording: Recording, counted: Mask) -> Vector:
    """Square roots (N,) of the samples' weights, whose mean over the counted samples is 1."""
    weights = recording.spread(recording.part_weights)
    return np.asarray(np.sqrt(weights / weights[counted].mean()))


def fit_forward(
    recording: Recording,
    counted: Mask,
    s: ModelStructure,
    states: States,
    v: Vector,
    qp_solver: ProgramSolver,
    *,
    steps: int = 6,
    searched: Sequence[bool] = (),
    weights_known: bool = False,
    further: Columns | None = None,
    creep_limits: Vector | float = np.inf,
    parameters: Parameters | None = None,
) -> ForwardFit:
    """Minimise the output error over the weights and other unknowns.

    Parameters
    ----------
    recording : Recording
        In the units of the structure.
    counted : array (N,) of bool
    states : sequence of OperatorState
        States before the first sample of each part.
    v : array (d,)
        Initial weights, slope coordinates.
    steps : int
        Maximum number of steps.
    searched : sequence of bool
        Whether the states of a part are unknowns, with ``states`` as initial values; for none by default.
    weights_known : bool
        Whether the weights are fixed.
    further : Columns, optional
    creep_limits : array (n + 1,) or float
        Upper bounds of the creep weights; infinite by default.
    parameters : Parameters, optional
        The dynamics, and which of their parameters are unknowns.

    Returns
    -------
    ForwardFit
    """
    further = further or Columns.none(recording.length)
    parts, free_parts = recording.parts, np.flatnonzero(np.array(searched, dtype=bool)).tolist()
    n, d, k = s.n * len(free_parts), s.d, further.lb.size
    box = bounds(s, further, creep_limits, n, parameters)
    if weights_known:
        box.lb[:d] = box.ub[:d] = v
    theta, with_lag = (np.zeros(0), False) if parameters is None else (parameters.vector, parameters.with_lag)
    curves = [np.diff(states[part].play[: s.n + 1]) / np.diff(s.thresholds) for part in free_parts]
    z = np.concatenate([v, np.clip(np.ravel(curves), -1.0, 1.0), np.zeros(k), theta])
    unit_y, scale = s.unit_output(recording.y), _error_scale(recording, counted)

    def trial(z: Vector, static: Vector | None = None) -> Trial:
        """Simulate at the point of the box nearest to z; the output before the dynamics may be known."""
        z, starts = box.project(z), list(states)
        for part, slopes in zip(free_parts, z[d : d + n].reshape(len(free_parts), s.n), strict=True):
            starts[part] = state_with_slopes(recording.x[parts[part]], s, slopes)
        weights = all_weights(s, s.slope_map @ z[:d])
        g = None if parameters is None else parameters.at(z[d + n + k :])
        at = {T: at_period(s, g, T) for T in recording.periods}
        models = {T: (own, arrays_of(own, weights), dynamics) for T, (own, dynamics) in at.items()}
        if static is None:
            qp_solver.passes += 1
            before = _by_parts(recording, recording.x, starts, lambda T, *drive: before_dynamics(*models[T], *drive))
            static = s.unit_output(before)
        y_model, ringing, further_output = static, np.zeros(1), further.signals @ z[d + n : d + n + k]
        if g is not None:
            before = s.y_centre + s.y_scale * static
            behind = _by_parts(recording, before, starts, lambda T, *drive: behind_dynamics(*models[T], *drive))
            y_model, modes = s.unit_output(behind), [at[T][1] for T in recording.periods]
            ringing = initial_ringing(modes, recording, unit_y - y_model - further_output, counted)
            y_model += ringing
        error = unit_y - y_model - further_output
        own = error * scale if counted.all() else (error * scale)[counted]
        return Trial(z, starts, g, static, y_model, ringing, error, float(own @ own) / own.size + EXACT)

    def linearised(at: Trial) -> tuple[Matrix, Vector, Mask]:
        """P and Jᵀe / N over all unknowns, and which weights moved."""
        qp_solver.passes += 1
        moves = [
            (trial(near, None if with_lag and near[-1] != at.z[-1] else at.static).y_model - at.y_model) / step
            for near, step in (box.step(at.z, along) for along in np.eye(z.size)[d + n + k :])
        ]
        gram, moved = _gram(recording, counted, s, at, free_parts, np.column_stack([further.signals, *moves]))
        return gram[:-1, :-1], gram[:-1, -1], moved

    best, P, free = trial(z), np.eye(z.size), box.lb < box.ub
    for _ in range(steps if free.any() else 0):
        z, (P, Je, moved) = best.z, linearised(best)
        determined = np.diag(P) > 0.0
        determined[:d] &= moved & (not weights_known)
        free = determined & box.inactive(z)
        if not determined.any():
            break
        at = np.ix_(determined, determined)
        target = z.copy()
        target[determined] = qp_solver.minimise(
            P[at],
            -Je[determined] - P[at] @ z[determined],
            box.lb[determined],
            box.ub[determined],
            z[determined],
        )
        slopes, reached = target[s.slices[1]], np.flatnonzero(determined[s.slices[1]])
        if reached.size:  # extrapolate the slopes of S⁻¹ beyond the outputs of the recording
            slopes[:] = np.minimum(np.interp(np.arange(slopes.size), reached, slopes[reached]), MAX_SLOPE)
        step = 1.0
        while not (stepped := trial(z + step * (target - z))).cost <= best.cost and step >= SHORTEST_STEP:
            step *= 0.5
        if (gain := best.cost - stepped.cost) > 0.0:
            best = stepped
            free = determined & box.inactive(best.z)
        if gain <= CONVERGED * best.cost:
            break
    kept: Index = np.r_[np.arange(d), np.arange(d + n, z.size)]

    def derivative(direction: Vector) -> Vector:
        along = np.zeros(z.size)
        along[kept] = direction
        near, step = box.step(best.z, along)
        return (best.error - trial(near).error) / step

    return ForwardFit(
        **vars(best),
        structure=s,
        further=best.z[d + n : d + n + k],
        counted=counted,
        recording=recording,
        P=P[np.ix_(kept, kept)],
        free=free[kept],
        parameters=None if best.dynamics is None or parameters is None else replace(parameters, start=best.dynamics),
        derivative=derivative,
        P_here=lambda: linearised(best)[0][np.ix_(kept, kept)],
    )


def bounds(
    s: ModelStructure,
    further: Columns,
    creep_limits: Vector | float,
    n: int = 0,
    parameters: Parameters | None = None,
) -> Box:
    """Bounds of all unknowns z, among them n initial slopes."""
    theta_lb, theta_ub = (np.zeros(0), np.zeros(0)) if parameters is None else parameters.bounds
    weights_ub = np.full(s.d, np.inf)
    weights_ub[s.slices[2]] = creep_limits
    lb = np.concatenate([s.lower_bounds(MIN_SLOPE), -np.ones(n), further.lb, theta_lb])
    return Box(lb, np.concatenate([weights_ub, np.ones(n), further.ub, theta_ub]))


def step_problem(
    recording: Recording, counted: Mask, fit: ForwardFit, problem: IdentificationProblem
) -> IdentificationProblem:
    """The program of the next step from a fit, in the form of the program (6) of the same recording and structure. The
    proximal term refers to the weights of the fit, and weights that no sample reaches stay there."""
    s, v = fit.structure, fit.v
    gram = _gram(recording, counted, s, fit, [], np.zeros((recording.length, 0)))[0]
    P, Je, S = gram[:-1, :-1], gram[:-1, -1], s.inverse_slope_map
    q, c = -Je - P @ v, 0.5 * (gram[-1, -1] + 2.0 * Je @ v + v @ P @ v)
    return replace(problem, P=S.T @ P @ S, q=S.T @ q, c=float(c), reference=fit.weights)


def _gram(
    recording: Recording,
    counted: Mask,
    s: ModelStructure,
    at: Trial,
    free_parts: Sequence[int],
    further: Matrix,
) -> tuple[Matrix, Mask]:
    """Means over the counted samples of the products of the columns of J, further columns (N, k) and e, and which
    operators moved (d,)."""
    v, slopes = at.z[: s.d], piece_slopes(s, at.z[: s.d], at.static)
    unfiltered = np.column_stack([further, at.error])
    nudges = [np.where(state.play[1 : s.n + 1] > state.play[0], -NUDGE, NUDGE) for state in at.states]
    nudged = [_nudge(s, *pair) for pair in zip(at.states, nudges, strict=True)]
    steps = np.tril(np.ones((s.n, s.n))) * np.diff(s.thresholds)  # dz_i / d(slope j)

    def columns(part: int, samples: slice, rows: Matrix, *others: Matrix) -> Matrix:
        J = rows[:, 1:] / slopes[samples, None]
        if not free_parts:
            return J
        by_slopes = np.zeros((len(rows), len(free_parts), s.n))
        if part in free_parts:
            change = (others[0] - rows)[:, 1:] * v
            creeps = change[:, s.slices[2]][:, 1:] if s.creep_rates else 0.0
            by_slopes[:, free_parts.index(part)] = (change[:, : s.n] + creeps) / nudges[part] @ steps
        return np.hstack([J, by_slopes.reshape(len(rows), -1) / slopes[samples, None]])

    starts = (at.states, nudged) if free_parts else (at.states,)
    return gram_of(recording, counted, s, starts, at.static, columns, unfiltered, slopes=True, dynamics=at.dynamics)


def _nudge(s: ModelStructure, state: OperatorState, nudges: Vector) -> OperatorState:
    """The states with a perturbation of those of all thresholds above zero."""
    nudged = state.copy()
    nudged.play[1 : s.n + 1] += nudges
    nudged.creep.reshape(-1, s.lanes)[:, 1 : s.n + 1] += nudges
    return nudged
