"""Whether a recording determines creep, or a drift of the sensor, whatever its hysteresis is.

Over a drive of one frequency, creep and hysteresis have the same loops, so a fit tells them apart by its noise alone,
and a model with creep is then wrong at every other speed. Creep is therefore judged against *any* rate-independent
operator: a regression of the output on piecewise linear functions of plays,

    y = Σ_i f_i(H_ri [x]) + c + d t,   r_i = i / 11,   with knots over the range of each play,

and what that leaves of y and of the creep states z_a, one rate a a decade. A rate is admissible if at least
INFORMATION of its state is left. Over one frequency that is the settling of a state that began at rest, which a drift,
or creep from before the recording, resembles: the drive determines creep if DRIVEN of a state is left beside a drift
and decays exp(−a t), too, as after a held step or at two speeds a hundred times apart. The creep of all admissible
rates, κ Σ_a z_a with 0 ≤ κ ≤ LARGEST, is in the data if it explains the larger share of what the regression leaves
beyond noise, and κ is far from 0. The variance of the noise is that of the third differences of the residual, in which
all that is slow cancels. A drift d is judged beside creep, not before it, since over a held step the two are alike.

An actuator without return-point memory is no function of plays, but while the drive is held any rate-independent
operator rests. So creep that the whole does not show is judged again over the held samples, beside a level of each.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.4, for a Preisach operator as a
superposition of functions of plays.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_model.identification.autocorrelation import independent_samples
from piezo_model.identification.error_model import Solving
from piezo_model.identification.forward import EXACT, ForwardFit
from piezo_model.identification.gram_matrix import STILL
from piezo_model.operators import creep, play
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Index, Mask, Matrix, Vector

PLAYS, KNOTS, SAMPLES, ENOUGH = 10, 6, 20_000, 2000
"""Thresholds above zero of the regression, and knots of each function over the whole range, twice as many for r = 0;
its samples, spread over the recording, and those from which it has all columns."""
RANK, INFORMATION, DRIVEN = 1e-12, 0.03, 0.09
"""Smallest eigenvalue of the columns' Gram matrix, as a share of the largest, that is no rounding error; smallest share
of a creep state that the regression leaves, and that it, a drift and all decays of an earlier state leave."""
LARGEST, NEGLIGIBLE = 0.1, 0.005
"""Largest creep that is admitted, and its upper limit below which the recording shows none, as shares of the movement
in a decade of time."""
SHARE, CHI_SQUARE, MARGIN = 0.5, 25.0, 2.0
"""Smallest share of the explainable error that creep explains, smallest (κ / se)², and standard errors by which the
weight of a model may differ from its estimate here."""
DRIFT_INFORMATION, DRIFT_SHARE, DRIFT_CHI_SQUARE = 0.3, 0.5, 16.0
SHORTEST_HOLD, STEADY, HELD_SHARE = 100, 1e-3, 0.1
"""Fewest samples of a hold; largest range of the drive in it, as a share of its whole range; smallest share of held
samples at which they are judged alone."""
UNDETERMINED, INDISTINCT, ABSENT = (
    "Creep is not determined by this recording; hold a step for a minute.",
    "Creep cannot be distinguished from hysteresis in this recording; hold a step for a minute.",
    "The recording shows no creep, although its drive would show it.",
)

Columns = list[tuple[Vector, float]]
"""Columns (M,), each with the limit of its coefficient."""


@dataclass(frozen=True)
class Bounded:
    """An estimate with its standard error."""

    value: float
    se: float

    @property
    def limits(self) -> tuple[float, float]:
        """Those of the weight in a model."""
        return self.value - MARGIN * self.se, self.value + MARGIN * self.se


@dataclass(frozen=True)
class CreepEvidence:
    """What a recording determines beside hysteresis."""

    rates: tuple[float, ...]
    """Admissible creep rates in 1/s, whether there is creep or not, fastest first; none if the drive determines no
    creep."""
    creep: Bounded | None
    """κ, the share of the output's movement that creep adds in a decade of time; None if it is not determined."""
    drift: Bounded | None
    """Drift over half the recording, normalised units; None without one."""
    shows_drift: bool
    """Whether the drive tells a drift from hysteresis."""
    share: float
    chi_square: float
    absent: bool
    """Whether the held samples exclude more than negligible creep; beside those that move, a hysteresis that is no
    function of plays may hide it."""
    independent: float
    """Number of independent samples in what is left of the output."""

    @property
    def is_clear(self) -> bool:
        """Whether the recording tells creep from hysteresis."""
        return self.creep is not None or self.absent

    def sentence(self, rates: Sequence[float], chosen: bool) -> str:
        """What a user of a model with these rates, given or ``chosen``, should know of its creep; "" if nothing."""
        if self.creep is not None:
            return "" if rates else "The recording holds creep, which the model leaves out."
        why = UNDETERMINED if not self.rates else ABSENT if self.absent else INDISTINCT
        return f"The creep of the given rates is a guess. {why}" if rates else why * chosen

    def to_dict(self, rates: Sequence[float], chosen: bool) -> dict[str, Any]:
        """What is said of creep, for JSON."""
        return {
            "determined": self.creep is not None,
            "chosen": chosen,
            "rates": self.rates,
            "share": self.share,
            "chi_square": self.chi_square,
            "absent": self.absent,
            "sentence": self.sentence(rates, chosen),
        }

    def creep_limits(self, s: ModelStructure, fit: ForwardFit) -> Vector | None:
        """Upper bounds (n + 1,) of the creep weights of a structure with these rates, from the slope of S⁻¹ in a fit;
        None for structures without."""
        if self.creep is None or not s.creep_rates:
            return None
        limits = np.zeros(s.n + 1)
        limits[0] = self.creep.limits[1] * float(np.mean(fit.v[fit.structure.slices[1]]))
        return limits


@dataclass(frozen=True)
class Drift:
    """A drift of the sensor, output unit per second; it is no part of the model."""

    per_s: float
    se: float
    rms_percent: float
    """Error of the model without the drift, per cent of the output's range."""


def candidate_rates(sample_time: float, duration_s: float) -> tuple[float, ...]:
    """Rates in 1/s, one a decade, from up to ten times the length of the recording to ten sampling periods, fastest
    first. All share one weight, so that creep goes on beyond the recording as it did within it.

    Examples
    --------
    >>> candidate_rates(1e-2, 2.0)
    (10.0, 1.0, 0.1)
    """
    slowest, fastest = math.log10(1.0 / duration_s), math.log10(0.1 / sample_time)
    return tuple(float(f"{10.0**k:.6g}") for k in range(math.floor(fastest + 1e-9), math.floor(slowest + 1e-9) - 1, -1))


def determine(recording: Recording, counted: Mask, fit: ForwardFit, solving: Solving) -> CreepEvidence:
    """Judge creep and drift over all samples beside the memory curve of a fit, and over the held ones alone, where any
    hysteresis rests."""
    s, count, parts = fit.structure, int(np.count_nonzero(counted)), recording.parts
    longest = max(part.stop - part.start for part in parts)
    rates = candidate_rates(recording.sample_time, (longest - 1) * recording.sample_time)
    at = np.flatnonzero(counted)[:: math.ceil(count / SAMPLES)]
    edges = np.searchsorted(at, recording.starts[1:])
    solving.passes += 1
    null, states, decays = _columns(recording, at, fit, rates, min(1.0, math.sqrt(count / ENOUGH)))
    signals = np.column_stack([s.unit_output(recording.y), np.linspace(-1.0, 1.0, recording.length)])[at]
    whole = _judged(null, signals, states, decays, rates, edges)
    hold = holds(recording)[at]
    held = hold >= 0
    if whole.creep is not None or np.count_nonzero(held) <= HELD_SHARE * at.size:
        return replace(whole, absent=False)
    levels = (hold[held, None] == np.unique(hold[held])).astype(np.float64)
    resting = _judged(levels, signals[held], states[held], decays[held], rates, edges[:0])
    if resting.creep is None:
        return replace(whole, absent=resting.absent)
    return replace(resting, independent=whole.independent, shows_drift=whole.shows_drift)


def holds(recording: Recording) -> Index:
    """Number of the hold that each sample of a recording (N,) lies in, and −1 where its drive moves.

    Examples
    --------
    >>> x = np.concatenate([np.zeros(200), np.linspace(0, 1, 50), np.ones(300)])
    >>> holds(Recording.from_arrays(x, x, 1e-3))[[0, 220, 400]].tolist()
    [0, -1, 1]
    """
    span, numbers, found = STEADY * float(np.ptp(recording.x)), np.full(recording.length, -1), 0
    for part in recording.parts:
        x = recording.x[part]
        ahead = np.lib.stride_tricks.sliding_window_view(x, SHORTEST_HOLD) if x.size >= SHORTEST_HOLD else x[:0, None]
        steady = np.concatenate([[False], np.ptp(ahead, axis=1) <= span, [False]])
        edges = part.start + np.flatnonzero(np.diff(steady.astype(np.int8)))
        for first, last in zip(edges[::2], edges[1::2] + SHORTEST_HOLD - 1, strict=True):
            if np.ptp(recording.x[first:last]) <= 2.0 * span:
                numbers[first:last], found = found, found + 1
    return numbers


def _judged(
    null: Matrix,
    signals: Matrix,
    states: Matrix,
    decays: Matrix,
    rates: tuple[float, ...],
    edges: Index,
) -> CreepEvidence:
    """Judge creep and drift beside the columns of a null (M, p); the signals (M, 2) are output and time, of parts that
    begin at the edges."""
    left, used = _residual(null, np.hstack([signals, states, decays]))
    error, drift, states_left = left[:, 0], left[:, 1], left[:, 2 : 2 + len(rates)]
    sizes = np.linalg.norm(states - states.mean(axis=0), axis=0)
    informed = np.linalg.norm(states_left, axis=0) >= INFORMATION * sizes
    steady = _residual(np.hstack([drift[:, None], left[:, 2 + len(rates) :]]), states_left)[0]
    driven = bool(np.any(np.linalg.norm(steady, axis=0) >= DRIVEN * sizes))
    known = float(np.linalg.norm(drift) / np.linalg.norm(signals[:, 1]))
    admitted = tuple(rate for rate, good in zip(rates, informed, strict=True) if good)
    creeping = [(states_left[:, informed].sum(axis=1), LARGEST)] if admitted else []
    drifting = [(drift, math.inf)] if known >= INFORMATION else []
    freedom = len(null) - used

    def independent(error: Vector) -> float:
        return max(min(independent_samples(np.split(error, edges)), freedom), 3.0)

    share, chi_square = _gain(error, drifting, creeping, independent)
    unlimited = [(column, math.inf) for column, _ in creeping]
    absent = driven and bool(creeping)
    absent = absent and 0.0 <= _fit(error, unlimited + drifting, independent)[0][0].limits[1] < NEGLIGIBLE
    if not (creeping and share >= SHARE and chi_square >= CHI_SQUARE):
        creeping = []
    explained, significance = _gain(error, creeping, drifting, independent)
    if not (known >= DRIFT_INFORMATION and explained >= DRIFT_SHARE and significance >= DRIFT_CHI_SQUARE):
        drifting = []
    estimates, left_over = _fit(error, creeping + drifting, independent)
    return CreepEvidence(
        admitted if driven else (),
        estimates[0] if creeping and driven else None,
        estimates[-1] if drifting else None,
        known >= DRIFT_INFORMATION,
        share,
        chi_square,
        absent,
        independent_samples(np.split(left_over, edges)),
    )


def _fit(error: Vector, columns: Columns, independent: Callable[[Vector], float]) -> tuple[list[Bounded], Vector]:
    """Coefficients of the columns by least squares, one after another within 0 and its limit, and the residual (M,)."""
    matrix, found = np.column_stack([column for column, _ in columns] or [error]), []
    for i, (column, limit) in enumerate(columns):
        value = float(np.linalg.lstsq(matrix[:, i:], error, rcond=None)[0][0])
        found.append(value if math.isinf(limit) else min(max(value, 0.0), limit))
        error = error - found[-1] * column
    variance = float(error @ error) / independent(error)
    ses = np.sqrt(variance) * np.linalg.norm(np.linalg.pinv(matrix), axis=1)
    return [Bounded(value, se) for value, se in zip(found, ses.tolist(), strict=False)], error


def _gain(
    error: Vector, columns: Columns, more: Columns, independent: Callable[[Vector], float]
) -> tuple[float, float]:
    """The share of the error left by some columns, beyond noise, that further columns explain, and its χ²."""
    fewer, residual = (_fit(error, each, independent)[1] for each in (columns, columns + more))
    before, after = float(fewer @ fewer), float(residual @ residual)
    noise = residual.size * float(np.mean(np.diff(residual, 3) ** 2)) / 20.0  # 20 = 1² + 3² + 3² + 1²
    explainable = before - min(noise, 0.999 * after)
    smallest = EXACT * residual.size
    return (before - after) / max(explainable, smallest), independent(residual) * (before - after) / max(
        after, smallest
    )


def _residual(columns: Matrix, signals: Matrix) -> tuple[Matrix, int]:
    """What the columns (M, p) leave of signals (M, k), and their rank."""
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > RANK * values[-1]
    basis = columns @ (vectors[:, kept] / np.sqrt(values[kept]))
    for _ in range(2):  # the second time against rounding
        signals = signals - basis @ (basis.T @ signals)
    return signals, int(np.count_nonzero(kept))


def _columns(
    recording: Recording, at: Index, fit: ForwardFit, rates: tuple[float, ...], richness: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Columns of the null, creep states of each rate, and decays of each in each part, at the samples ``at``."""
    s, count = fit.structure, max(1, int(PLAYS * richness))
    r, columns = np.arange(count + 1) / (count + 1), []
    plays, states = np.empty((at.size, r.size)), np.empty((at.size, len(rates)))
    decays = np.zeros((at.size, len(recording.starts), len(rates)))
    for i, (part, start) in enumerate(zip(recording.parts, fit.states, strict=True)):
        inside = (at >= part.start) & (at < part.stop)
        columns.append(inside.astype(np.float64))
        x, rows = s.unit_input(recording.x[part]), at[inside] - part.start
        for j, before in enumerate(np.interp(r, s.thresholds, start.play[: s.n + 1])):  # one by one, for the memory
            plays[inside, j] = play(x, r[j : j + 1], [before])[0][rows, 0]
        decays[inside, i] = np.exp(-np.outer(rows * s.sample_time, rates))
        for j, rate in enumerate(rates):
            states[inside, j] = creep(x, [0.0], [rate], s.sample_time, x[:1])[0][rows, 0]
    for j, z in enumerate(plays.T):
        low, high = float(z.min()), float(z.max())
        if high - low > STILL:
            density = KNOTS * richness * (2.0 if j == 0 else 0.5 * (high - low))
            knots = np.linspace(low, high, max(1, round(density)) + 2)[1:-1]
            columns += [z, *(np.maximum(z - knot, 0.0) for knot in knots)]
    return np.column_stack(columns), states, decays.reshape(at.size, -1)
