"""Choice of the orders n and m from one Gram matrix of the columns of all candidates.

Let ŷ be the output of a first fit, e = y − ŷ its error and s the slope of its S⁻¹ at ŷ. The output of a candidate is
ŷ + (x + Ξ(x, ŷ)ᵀw) / s up to second order in the difference, so its error

    e − (w_H0 x + Ξ(x, ŷ)ᵀw) / s

is linear in the weights, without the noise of y among the regressors. The slope of the middle piece of S⁻¹ is given,
and not w_H0 = 1, since small slopes would make any error small. One pass gives the Gram matrix of the columns

    x/s,  H_r [x]/s for all thresholds r,  −S_r' (ŷ)/s for all dead zones r',  z_r/s for all thresholds r,  1/s,  e,  t

from which the programs of all candidates follow without the samples. The criterion is the Bayesian information
criterion N_e ln V + d ln N_e; of the candidates within ALIKE of its minimum, the one with the fewest weights is chosen.
Here d counts the weights at no bound, and N_e is the number of independent samples: those in e, or in the residual of
hysteresis, creep and drift (`creep`), or N V / ν, whichever is largest. The variance ν is that of the noise alone at
the frequencies of the drive: a misfit that repeats with the drive has lines in the periodogram of e, which the median
over neighbouring frequencies removes.

Source: G. Schwarz, "Estimating the dimension of a model", Annals of Statistics 6 (1978) 461–464.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from piezo_model.identification.creep import CreepEvidence
from piezo_model.identification.error_model import ProgramSolver, States, percent_of
from piezo_model.identification.forward import MAX_SLOPE, Columns, ForwardFit, bounds, piece_slopes
from piezo_model.identification.gram_matrix import gram_of
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Index, Mask, Matrix, Vector

HYSTERESIS_ORDERS, SUPERPOSITION_ORDERS = (1, 2, 3, 5, 8, 12, 20), (0, 1, 2, 3, 5, 8)
SAMPLES, FEWEST_PER_WEIGHT, NEIGHBOURS = 100_000, 4, 31
"""Most samples of the Gram matrix, spread over the recording; fewest samples for each weight of a candidate;
frequencies of a periodogram over which the median is taken."""
ALIKE, EXACT = 2.0, 1e-12
"""Largest difference of criteria that is insignificant; cost at the level of rounding in a Gram matrix, in normalised
units squared, which no number of samples resolves."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Candidate:
    """A structure and its fit."""

    structure: ModelStructure
    states: States = field(repr=False)
    """States before the first sample of each part."""
    v: Vector = field(repr=False)
    """Weights (d,) in slope coordinates."""
    error_percent: float
    """RMS error of the output to first order, per cent of its full range."""
    bic: float

    def __str__(self) -> str:
        return f"n = {self.structure.n}, m = {self.structure.dead_zones // 2}"


@dataclass(frozen=True)
class Selection:
    """All candidates, the smallest criterion first."""

    candidates: tuple[Candidate, ...]

    @property
    def chosen(self) -> Candidate:
        """The candidate with the fewest weights among those whose criterion is within ALIKE of the smallest."""
        alike = (c for c in self.candidates if c.bic <= self.candidates[0].bic + ALIKE)
        return min(alike, key=lambda c: (c.structure.d, c.structure.n))

    @property
    def sentence(self) -> str:
        """The choice in words."""
        best = min(self.candidates, key=lambda candidate: candidate.error_percent)
        error, smallest = (f"{candidate.error_percent:.3g} %" for candidate in (self.chosen, best))
        lowest = "" if smallest == error else f"; the smallest error is {smallest}, with {best}"
        return (
            f"Of {len(self.candidates)} structures, {self.chosen} has the fewest weights of those within "
            f"{ALIKE:g} of the smallest information criterion, with an RMS error of about {error} of the output's "
            f"range{lowest}."
        )

    def to_dict(self) -> dict[str, Any]:
        """The sentence and the table, for JSON."""
        rows = [
            {
                "n": c.structure.n,
                "m": c.structure.dead_zones // 2,
                "creep_rates": list(c.structure.creep_rates),
                "d": c.structure.d,
                "error_percent": c.error_percent,
                "bic": c.bic - self.candidates[0].bic,
                "standing": "chosen" if c is self.chosen else "",
            }
            for c in self.candidates
        ]
        return {"sentence": self.sentence, "tried": len(rows), "table": rows}


def with_orders(s: ModelStructure, n: int, m: int, rates: Sequence[float]) -> ModelStructure:
    """The structure with other orders and creep rates, and equidistant thresholds."""
    other = ModelStructure.equidistant(n, m, (-1.0, 1.0), (-1.0, 1.0), (), s.sample_time)
    return replace(
        s,
        play_thresholds=other.play_thresholds,
        dead_zone_thresholds=other.dead_zone_thresholds,
        creep_rates=tuple(rates),
    )


def union_of(structures: Sequence[ModelStructure]) -> ModelStructure:
    """The last structure with the thresholds of all."""
    return replace(
        structures[-1],
        play_thresholds=tuple(sorted({r for s in structures for r in s.play_thresholds})),
        dead_zone_thresholds=tuple(sorted({r for s in structures for r in s.dead_zone_thresholds})),
    )


def state_on(s: ModelStructure, state: OperatorState, other: ModelStructure) -> OperatorState:
    """The memory curve of a structure, interpolated at the thresholds of another; creep rests with the plays."""
    play = np.interp(other.thresholds, s.thresholds, state.play[: s.n + 1])
    play = np.clip(play, state.play[0] - other.thresholds, state.play[0] + other.thresholds)
    return OperatorState.from_dict({"play": play, "creep": [play] * len(other.creep_rates)}, other)


def select(
    fit: ForwardFit,
    determined: CreepEvidence,
    rates: Sequence[Sequence[float]],
    qp_solver: ProgramSolver,
    span: float,
    levels: Columns,
    ns: Sequence[int],
    ms: Sequence[int],
) -> Selection:
    """Choose the orders among ``ns`` and ``ms``, and one of several sets of creep rates, in the neighbourhood of a fit.
    ``span`` is the output's full range; ``levels`` are columns with weights of their own.

    Candidates with too many weights for the samples are omitted, except the first.
    """
    counted = np.flatnonzero(fit.counted)
    at, most = counted[:: math.ceil(counted.size / SAMPLES)], counted.size / FEWEST_PER_WEIGHT
    independent = max(fit.independent, determined.independent, _beyond_noise(fit))
    candidates, further = [], levels.append(determined.trend_column(fit.recording))
    middle_slopes = {2 * m + 1: _middle_slope(with_orders(fit.structure, ns[0], m, ()), fit, at) for m in ms}
    for own in rates:
        orders = [with_orders(fit.structure, n, m, own) for n, m in product(ns, ms)]
        orders = [s for s in orders if s.d < most] or orders[:1]
        union = union_of(orders)
        gram = _gram(fit, at, union, further.signals, qp_solver)
        candidates += [
            _candidate(
                s, fit, middle_slopes[s.dead_zones], union, *gram, further, determined, independent, qp_solver, span
            )
            for s in orders
        ]
    return Selection(tuple(sorted(candidates, key=lambda candidate: candidate.bic)))


def _gram(
    fit: ForwardFit,
    at: Index,
    union: ModelStructure,
    further: Matrix,
    qp_solver: ProgramSolver,
) -> tuple[Matrix, Mask]:
    """Means over the samples ``at`` of the products of x/s, Ξ/s, e and further columns (N, k), and which of the columns
    Ξ moved."""
    s, chosen = fit.structure, np.zeros(fit.counted.size, dtype=bool)
    chosen[at] = True
    slopes, states = piece_slopes(s, fit.v, fit.static), [state_on(s, state, union) for state in fit.states]
    qp_solver.passes += 1
    return gram_of(
        fit.recording,
        chosen,
        union,
        [states],
        fit.y_model,
        lambda _, at, rows: rows / slopes[at, None],
        np.column_stack([fit.error, further]),
    )


def _beyond_noise(fit: ForwardFit) -> float:
    """Number of samples N V / ν of the error of a fit, summed over the recordings."""
    owners, samples = fit.recording.spread(fit.recording.owners), 0.0
    for owner in set(fit.recording.owners):
        own = fit.counted & (owners == owner)
        squares = float(fit.error[own] @ fit.error[own]) + EXACT * np.count_nonzero(own)
        samples += squares / (noise_floor(fit.recording, own, fit.error) + EXACT)
    return samples


def noise_floor(recording: Recording, counted: Mask, error: Vector) -> float:
    """Variance of the noise in an error (N,), from its periodogram at the frequencies of the drive without lines.

    Examples
    --------
    >>> t, white = np.arange(4000), np.random.default_rng(0).normal(size=4000)
    >>> recording = Recording.from_arrays(np.sin(t / 50), white, 1e-3)
    >>> error = white + 5 * np.sin(t / 50)
    >>> bool(error.var() > 13.0), bool(0.4 < noise_floor(recording, t >= 0, error) < 4.0)
    (True, True)
    """
    noise, power = 0.0, 0.0
    for part in recording.parts:
        inside = counted[part]
        if np.count_nonzero(inside) < NEIGHBOURS:
            continue
        pair = error[part][inside], recording.x[part][inside]
        window = np.hanning(pair[0].size)
        E, X = (np.abs(np.fft.rfft((signal - signal.mean()) * window)[1:]) ** 2 for signal in pair)
        floor = median_filter(E, NEIGHBOURS, mode="nearest") / math.log(2.0)  # mean of an exponential from its median
        noise, power = noise + float(floor @ X) / float(window @ window), power + float(X.sum())
    return noise / power if power else math.inf


def _candidate(
    s: ModelStructure,
    fit: ForwardFit,
    slope: float,
    union: ModelStructure,
    gram: Matrix,
    moved: Mask,
    further: Columns,
    determined: CreepEvidence,
    independent: float,
    qp_solver: ProgramSolver,
    span: float,
) -> Candidate:
    """The fit of one structure with the slope of the middle piece of S⁻¹, and of a trend if there is one, from the Gram
    matrix."""
    find, (_, zones, creeps) = np.searchsorted, union.slices
    of = np.r_[  # its weights among those of the union
        find(union.play_thresholds, s.play_thresholds),
        zones.start + find(union.dead_zone_thresholds, s.dead_zone_thresholds),
        creeps.start + find(union.thresholds, s.thresholds)[: s.creep_weights],
        np.full(int(s.offset), union.d - 1),
    ]
    e, k = union.d + 1, further.lb.size
    T = np.eye(1 + s.d + k)
    T[1 : 1 + s.d, 1 : 1 + s.d] = s.slope_map
    columns = np.r_[0, 1 + of, e + 1 + np.arange(k)]
    P, q = T.T @ gram[np.ix_(columns, columns)] @ T, -T.T @ gram[columns, e]
    box = bounds(s, further, determined.creep_limits(s, fit))
    lb, ub = np.append(slope / MAX_SLOPE, box.lb), np.append(np.inf, box.ub)
    z = np.concatenate([[1.0], slope * s.inverse_slope_map @ s.straight_line, np.zeros(k)])
    free = np.r_[True, moved[of], np.full(k, True)] & (np.diag(P) > 0.0) & (np.arange(z.size) != 1 + s.n + s.middle)
    z[free] = qp_solver.minimise(
        P[np.ix_(free, free)], (q + P @ np.where(free, 0.0, z))[free], lb[free], ub[free], z[free]
    )
    cost = max(float(z @ P @ z + 2.0 * q @ z + gram[e, e]), 0.0) + EXACT
    return Candidate(
        s,
        [state_on(fit.structure, state, s) for state in fit.states],
        z[1 : 1 + s.d] / z[0],
        percent_of(span, abs(s.y_scale) * math.sqrt(cost)),
        independent * math.log(cost) + np.count_nonzero(box.inactive(z[1:])[: s.d]) * math.log(independent),
    )


def _middle_slope(s: ModelStructure, fit: ForwardFit, at: Index) -> float:
    """Slope of S⁻¹ in the middle piece of a structure: the median of those of a fit there at the samples ``at``, since
    some pieces of the fit, which the output only crosses, may be at the bound of their slopes."""
    y = np.append(fit.static[at], 0.0)  # the middle of its range is in the piece, if no sample is
    inside = np.abs(y) <= (*s.dead_zone_thresholds[s.middle + 1 :], math.inf)[0]
    return float(np.median(piece_slopes(fit.structure, fit.v, y[inside])))
