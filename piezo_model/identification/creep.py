"""Whether a recording determines creep, or a drift of the sensor, independently of the model of hysteresis.

At a single drive frequency, creep and hysteresis produce the same loops, so a fit separates them by noise alone, and a
model with creep is then wrong at every other speed. Creep is therefore tested against *any* rate-independent operator:
a regression of the output on piecewise linear functions of plays,

    y = Σ_i f_i(H_ri [x]) + c + d t − τ dŷ/dt,   r_i = i / 11,   with knots over the range of each play,

where ŷ is the output of the first fit, since fast creep looks like a lag τ of a smooth output. It is judged by the
residuals of y and of the creep states z_a, for one rate a per decade. A rate is admissible if the residual is at least
INFORMATION of its state. At a single frequency that residual is the settling of a state that began at rest, which
looks like a drift, or like creep from before the recording. So the drive determines creep only if DRIVEN of a state
also remains next to a drift and decays exp(−a t), as after a held step, or with two speeds a factor of a hundred apart.
The creep of all admissible rates, κ Σ_a z_a with 0 ≤ κ ≤ LARGEST, is in the data if it explains most of what the
regression leaves beyond noise, and κ differs significantly from 0. If creep of fewer decades, or at rates between the
powers of ten, explains significantly more, its rates are taken. The variance of the noise is that of the third
differences of the residual, in which everything slow cancels, plus two of its standard errors. A drift d is tested
together with creep, not before it, since during a held step the two look alike.

An actuator without return-point memory is no function of plays, but while the drive is held any rate-independent
operator rests. So if the whole recording shows no creep, the samples of its holds are tested again, with a free level
for each hold. No operator hides anything there, so the drive determines creep, too, if creep explains significantly
more than a drift and the decays.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.4, for a Preisach operator as a
superposition of functions of plays.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from piezo_model.identification.autocorrelation import independent_samples
from piezo_model.identification.error_model import ProgramSolver
from piezo_model.identification.forward import EXACT, Columns, ForwardFit
from piezo_model.identification.gram_matrix import STILL
from piezo_model.operators import creep, play
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Index, Mask, Matrix, Vector

PLAYS, KNOTS, SAMPLES, ENOUGH = 10, 6, 20_000, 2000
"""Thresholds above zero of the regression; knots of a function over the whole range, twice as many for r = 0; most
samples, spread over the recording; fewest samples for all columns."""
RANK, INFORMATION, DRIVEN = 1e-12, 0.03, 0.09
"""Smallest eigenvalue of the columns' Gram matrix, relative to the largest, above rounding; smallest fraction of a
creep state in the residual of the regression, and in that of the regression with a drift and all decays of an earlier
state."""
SHIFTS = 0.0, 0.25, 0.5, 0.75
"""Fractions of a decade by which the grids of rates are shifted."""
LARGEST, NEGLIGIBLE = 0.1, 0.005
"""Largest creep of a model, and largest upper limit of a recording that shows none, as fractions of the movement in a
decade of time."""
SHARE, CHI_SQUARE, MARGIN, NOISE_ERROR = 0.5, 25.0, 2.0, 4.3
"""Smallest fraction of the explainable error that creep has to explain; smallest (κ / se)²; standard errors by which
the weight of a model may differ from its estimate; two relative standard errors of a variance from N third differences,
times √N."""
DRIFT_INFORMATION, DRIFT_SHARE, SETTLING_SHARE, DRIFT_CHI_SQUARE = 0.3, 0.5, 0.6, 16.0
"""The same for a drift or a settling; creep of other rates than the model's looks like a settling, which has to explain
more. The last is also the smallest gain of other rates than all of the first grid, in variances of the noise."""
SHORTEST_HOLD, STEADY, HELD_SHARE = 100, 1e-3, 0.1
"""Fewest samples of a hold; largest range of the drive during a hold, relative to its whole range; smallest fraction of
the samples in holds for a test of the holds alone."""
UNDETERMINED, INDISTINCT, ABSENT = (
    "Creep is not determined by this recording; hold a step for a minute.",
    "Creep cannot be distinguished from hysteresis in this recording; hold a step for a minute.",
    "The recording shows no creep, although its drive would show it.",
)

LimitedColumns = list[tuple[Vector, float]]
"""Columns (M,), each with the upper limit of its coefficient."""


@dataclass(frozen=True)
class Estimate:
    """An estimate with its standard error."""

    value: float
    se: float

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the weight in a model."""
        return self.value - MARGIN * self.se, self.value + MARGIN * self.se


@dataclass(frozen=True)
class CreepEvidence:
    """What a recording shows of creep and drift."""

    rates: tuple[float, ...]
    """Rates in 1/s, fastest first, of the creep, or all admissible ones if there is none; empty if the drive does not
    determine creep."""
    creep: Estimate | None
    """κ, the fraction of the movement that creep adds in a decade of time; None if undetermined."""
    trend: Estimate | None
    """Half of the change by a drift or a settling over the recording, normalised units; None without one."""
    settling: tuple[float, ...]
    """Rates in 1/s of creep from before the recording that settles; empty for a drift or no trend."""
    shows_drift: bool
    """True if the drive distinguishes a drift from hysteresis."""
    share: float
    chi_square: float
    absent: bool
    """True if the holds exclude more than negligible creep. (While the drive moves, hysteresis that is no function of
    plays may hide it.)"""
    independent: float
    """Number of independent samples in the residual of the output."""

    @property
    def is_clear(self) -> bool:
        """True if the recording distinguishes creep from hysteresis."""
        return self.creep is not None or self.absent

    def sentence(self, rates: Sequence[float], chosen: bool) -> str:
        """What a user should know about creep in a model with these rates, ``chosen`` from the data or not; "" if
        nothing."""
        if self.creep is not None:
            return "" if rates else "The recording shows creep, which the model does not include."
        why = UNDETERMINED if not self.rates else ABSENT if self.absent else INDISTINCT
        return f"Creep at the rates specified is a guess. {why}" if rates else why * chosen

    def to_dict(self, rates: Sequence[float], chosen: bool) -> dict[str, Any]:
        """The evidence of creep and its sentence, for JSON."""
        return {
            "determined": self.creep is not None,
            "chosen": chosen,
            "rates": self.rates,
            "share": self.share,
            "chi_square": self.chi_square,
            "absent": self.absent,
            "sentence": self.sentence(rates, chosen),
        }

    def creep_limits(self, s: ModelStructure, fit: ForwardFit) -> Vector | float:
        """Upper bounds (n + 1,) of the creep weights of a structure with these rates, by the slope of S⁻¹ in a fit;
        infinite without creep."""
        if self.creep is None or not s.creep_rates:
            return math.inf
        limits = np.zeros(s.n + 1)
        limits[0] = self.creep.limits[1] * float(np.mean(fit.v[fit.structure.slices[1]]))
        return limits

    def trend_column(self, recording: Recording) -> Columns:
        """The column of the trend, within its limits; none without a trend."""
        if self.trend is None:
            return Columns.none(recording.length)
        return Columns.of(course(recording.time, recording.duration_s, self.settling), *self.trend.limits)


def candidate_rates(sample_time: float, duration_s: float, shift: float = 0.0) -> tuple[float, ...]:
    """Rates in 1/s, one per decade and fastest first, with time constants from ten sampling periods to at most ten
    times the duration: powers of ten, or these shifted by a fraction of a decade. All share one weight, so that creep
    continues after the recording as it does within it.

    Examples
    --------
    >>> candidate_rates(1e-2, 2.0)
    (10.0, 1.0, 0.1)
    """
    fastest, slowest = (math.floor(math.log10(rate) - shift + 1e-9) for rate in (0.1 / sample_time, 1.0 / duration_s))
    return tuple(float(f"{10.0 ** (k + shift):.6g}") for k in range(fastest, slowest - 1, -1))


def determine(fit: ForwardFit, qp_solver: ProgramSolver) -> CreepEvidence:
    """Test for creep and drift over all samples of a fit, with its memory curve, and then over the holds alone, during
    which any hysteresis rests."""
    s, recording, count = fit.structure, fit.recording, int(np.count_nonzero(fit.counted))
    duration_s = max(part.stop - part.start - 1 for part in recording.parts) * recording.sample_time
    grids = [candidate_rates(recording.sample_time, duration_s, shift) for shift in SHIFTS]
    at = np.flatnonzero(fit.counted)[:: math.ceil(count / SAMPLES)]
    edges = np.searchsorted(at, recording.starts[1:])
    qp_solver.passes += 1
    columns, states, decays = _columns(at, fit, grids, min(1.0, math.sqrt(count / ENOUGH)))
    settlings = [grids[0][first:] for first in range(len(grids[0]), -1, -1)]
    trends = [course(recording.time[at], recording.duration_s, settling) for settling in settlings]
    signals = np.column_stack([s.unit_output(recording.y)[at], *trends])
    whole = _judge(columns, signals, states, decays, grids, edges)
    hold = holds(recording)[at]
    rests = hold >= 0
    if whole.creep is not None or np.count_nonzero(rests) <= HELD_SHARE * at.size:
        return replace(whole, absent=False)
    levels = (hold[rests, None] == np.unique(hold[rests])).astype(np.float64)
    resting = _judge(levels, signals[rests], states[rests], decays[rests], grids, edges[:0], at_rest=True)
    if resting.creep is None:
        return replace(whole, absent=resting.absent)
    return replace(resting, independent=whole.independent, shows_drift=whole.shows_drift)


def course(time: Vector, duration_s: float, settling: Sequence[float]) -> Vector:
    """Course of a drift, or of a settling at some rates, from −1 to 1, at times (N,) from −1 to 1 over a duration."""
    if not settling:
        return time
    left, at_end = (sum(np.exp(-0.5 * rate * duration_s * (t + 1.0)) for rate in settling) for t in (time, 1.0))
    return np.asarray(1.0 - 2.0 * (left - at_end) / (len(settling) - at_end))


def holds(recording: Recording) -> Index:
    """Number of the hold to which each sample (N,) belongs; −1 while the drive moves.

    Examples
    --------
    >>> x = np.concatenate([np.zeros(200), np.linspace(0, 1, 50), np.ones(300)])
    >>> holds(Recording.from_arrays(x, x, 1e-3))[[0, 220, 400]].tolist()
    [0, -1, 1]
    """
    span, numbers, count = STEADY * float(np.ptp(recording.x)), np.full(recording.length, -1), 0
    for part in recording.parts:
        x = recording.x[part]
        ahead = np.lib.stride_tricks.sliding_window_view(x, SHORTEST_HOLD) if x.size >= SHORTEST_HOLD else x[:0, None]
        steady = np.concatenate([[False], np.ptp(ahead, axis=1) <= span, [False]])
        edges = part.start + np.flatnonzero(np.diff(steady.astype(np.int8)))
        for first, last in zip(edges[::2], edges[1::2] + SHORTEST_HOLD - 1, strict=True):
            if np.ptp(recording.x[first:last]) <= 2.0 * span:
                numbers[first:last], count = count, count + 1
    return numbers


def _judge(
    columns: Matrix,
    signals: Matrix,
    states: Matrix,
    decays: Matrix,
    grids: Sequence[tuple[float, ...]],
    edges: Index,
    at_rest: bool = False,
) -> CreepEvidence:
    """Test for creep and a trend with the columns (M, p) of the null hypothesis; the signals (M, ·) are the output, a
    line over the time, and the settling from ever faster rates on, of parts that begin at the edges."""
    residuals, rank = _residual(columns, np.hstack([signals, states, decays]))
    rates, ends = grids[0], np.cumsum([1, signals.shape[1] - 1, states.shape[1]])
    error, (trends, all_creeps, decays) = residuals[:, 0], np.split(residuals, ends, axis=1)[1:]
    sizes = np.linalg.norm(states - states.mean(axis=0), axis=0)
    all_informed = np.linalg.norm(all_creeps, axis=0) >= INFORMATION * sizes
    creeps, informed, sizes = (values[..., : len(rates)] for values in (all_creeps, all_informed, sizes))
    known = np.linalg.norm(trends, axis=0) / np.linalg.norm(signals[:, 1:] - signals[:, 1:].mean(axis=0), axis=0)
    admissible = tuple(rate for rate, is_informed in zip(rates, informed, strict=True) if is_informed)
    creeping = [(creeps[:, informed].sum(axis=1), LARGEST)] if admissible else []

    def independent(error: Vector) -> float:
        return max(min(independent_samples(np.split(error, edges)), len(columns) - rank), 3.0)

    drifting = [(trends[:, 0], math.inf)] if known[0] >= INFORMATION else []
    share, chi_square = _gain(error, drifting, creeping, independent)
    steady = _residual(np.hstack([trends[:, :1], decays]), creeps)[0]
    others = [(column, math.inf) for column in (trends[:, 0], *decays.T)]
    driven = bool(np.any(np.linalg.norm(steady, axis=0) >= DRIVEN * sizes)) or (
        at_rest and _gain(error, others, creeping, independent)[1] >= CHI_SQUARE
    )
    unlimited = [(column, math.inf) for column, _ in creeping] * driven
    absent = bool(unlimited) and 0.0 <= _fit(error, unlimited + drifting, independent)[0][0].limits[1] < NEGLIGIBLE
    if not (creeping and share >= SHARE and chi_square >= CHI_SQUARE):
        creeping = []
    if creeping and driven:
        chosen = _spectrum(error, all_creeps, all_informed, [len(grid) for grid in grids], independent)
        creeping = [(all_creeps[:, chosen].sum(axis=1), LARGEST)]
        admissible = tuple(np.concatenate(grids)[chosen].tolist())
    left = [_fit(error, [*creeping, (trend, math.inf)], independent)[1] for trend in trends.T]
    costs, count = np.array([float(one @ one) for one in left]), independent(left[0])
    costs[0] *= 1.0 - math.log(count) / count
    kind = int(np.argmin(np.where(known < DRIFT_INFORMATION, math.inf, costs)))
    drifting = [(trends[:, kind], math.inf)] if known[kind] >= DRIFT_INFORMATION else []
    explained, significance = _gain(error, creeping, drifting, independent)
    if not (explained >= (SETTLING_SHARE if kind else DRIFT_SHARE) and significance >= DRIFT_CHI_SQUARE):
        drifting = []
    estimates, left_over = _fit(error, creeping + drifting, independent)
    return CreepEvidence(
        admissible if driven else (),
        estimates[0] if creeping and driven else None,
        estimates[-1] if drifting else None,
        rates[len(rates) - kind :] if drifting else (),
        bool(known[0] >= DRIFT_INFORMATION),
        share,
        chi_square,
        absent,
        independent_samples(np.split(left_over, edges)),
    )


def _spectrum(
    error: Vector, creeps: Matrix, informed: Mask, sizes: Sequence[int], independent: Callable[[Vector], float]
) -> Index:
    """Numbers of those consecutive admissible rates of one of the grids, which have ``sizes`` rates, whose creep
    explains the most of an error (M,); of all those of the first grid unless others explain significantly more."""
    grids = [grid[informed[grid]] for grid in np.split(np.arange(informed.size), np.cumsum(sizes)[:-1])]
    spectra = [grid[first:last] for grid in grids for first, last in combinations(range(grid.size + 1), 2)]
    spectra.insert(0, grids[0])
    columns = np.column_stack([creeps[:, spectrum].sum(axis=1) for spectrum in spectra])
    products, squares = columns.T @ error, np.sum(columns**2, axis=0)
    kappa = np.clip(products / squares, 0.0, LARGEST)
    left = float(error @ error) - kappa * (2.0 * products - kappa * squares)
    best, count = int(np.argmin(left)), independent(error - kappa[0] * columns[:, 0])
    return spectra[best if left[best] < (1.0 - DRIFT_CHI_SQUARE / count) * left[0] else 0]


def _fit(
    error: Vector, columns: LimitedColumns, independent: Callable[[Vector], float]
) -> tuple[list[Estimate], Vector]:
    """Coefficients of the columns by least squares, clipped in turn to 0 and their limits, and the residual (M,)."""
    matrix, values = np.column_stack([column for column, _ in columns] or [error]), []
    for i, (column, limit) in enumerate(columns):
        value = float(np.linalg.lstsq(matrix[:, i:], error, rcond=None)[0][0])
        values.append(value if math.isinf(limit) else min(max(value, 0.0), limit))
        error = error - values[-1] * column
    ses = np.sqrt(error @ error / independent(error)) * np.linalg.norm(np.linalg.pinv(matrix), axis=1)
    return [Estimate(value, se) for value, se in zip(values, ses.tolist(), strict=False)], error


def _gain(
    error: Vector, columns: LimitedColumns, more: LimitedColumns, independent: Callable[[Vector], float]
) -> tuple[float, float]:
    """The fraction of the residual of some columns, beyond noise, that further columns explain, and its χ²."""
    fewer, residual = (_fit(error, regressors, independent)[1] for regressors in (columns, columns + more))
    before, after = float(fewer @ fewer), float(residual @ residual)
    # 20 = 1² + 3² + 3² + 1²
    noise = float(np.mean(np.diff(residual, 3) ** 2)) / 20.0 * (residual.size + NOISE_ERROR * math.sqrt(residual.size))
    explainable = before - min(noise, 0.999 * after)
    smallest = EXACT * residual.size
    return (before - after) / max(explainable, smallest), independent(residual) * (before - after) / max(
        after, smallest
    )


def _residual(columns: Matrix, signals: Matrix) -> tuple[Matrix, int]:
    """Residuals of signals (M, k) after a regression on the columns (M, p), and the rank of these."""
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > RANK * values[-1]
    basis = columns @ (vectors[:, kept] / np.sqrt(values[kept]))
    for _ in range(2):  # reorthogonalise against rounding
        signals = signals - basis @ (basis.T @ signals)
    return signals, int(np.count_nonzero(kept))


def _columns(
    at: Index, fit: ForwardFit, grids: Sequence[tuple[float, ...]], richness: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Columns of the null hypothesis, creep states of each rate, and decays of each rate in each part, at the samples
    ``at``."""
    s, recording, count = fit.structure, fit.recording, max(1, int(PLAYS * richness))
    r, columns = np.arange(count + 1) / (count + 1), []
    rates, every = grids[0], np.concatenate(grids)
    plays, states = np.empty((at.size, r.size)), np.empty((at.size, every.size))
    decays, change = np.zeros((at.size, len(recording.starts), len(rates))), np.empty(at.size)
    for i, (part, start) in enumerate(zip(recording.parts, fit.states, strict=True)):
        inside = (at >= part.start) & (at < part.stop)
        columns.append(inside.astype(np.float64))
        x, rows = s.unit_input(recording.x[part]), at[inside] - part.start
        change[inside] = np.diff(fit.y_model[part], prepend=fit.y_model[part][:1])[rows]
        for j, before in enumerate(np.interp(r, s.thresholds, start.play[: s.n + 1])):  # one at a time, to save memory
            plays[inside, j] = play(x, r[j : j + 1], [before])[0][rows, 0]
        decays[inside, i] = np.exp(-np.outer(rows * s.sample_time, rates))
        for j, rate in enumerate(every):
            states[inside, j] = creep(x, [0.0], [rate], s.sample_time, x[:1])[0][rows, 0]
    columns.append(change)
    for j, z in enumerate(plays.T):
        low, high = float(z.min()), float(z.max())
        if high - low > STILL:
            density = KNOTS * richness * (2.0 if j == 0 else 0.5 * (high - low))
            knots = np.linspace(low, high, max(1, round(density)) + 2)[1:-1]
            columns += [z, *(np.maximum(z - knot, 0.0) for knot in knots)]
    return np.column_stack(columns), states, decays.reshape(at.size, -1)
