"""Faults of the bench: each is a hypothesis about a drive x(k), an output y(k) and the output ŷ(k) of the model.

    repeated output    y(k) = y(k − 1) exactly, where neighbours differ by more than the quantum of y
    held output        y changes at k = k₀ + j p only, p ≥ 2
    limit              y = L − b max(t − f, 0), where t is the drive's distance from the end of a rise, f ≥ 5 %
    slew limit         edges of size A rise at a slope A^c with c near 0 and far from the 1 of a linear stage
    lost rows          y(k) = F[x](k) before some sample and F[x](k + a) after it, for functions F of plays
    clock jitter       E e² = σ² + τ² (dŷ/dt)² for a white e = y − ŷ

A hypothesis is a function that returns its evidence, a sentence, or None where the data do not show it or leave it
open. A slope that falls to zero abruptly, before the drive turns, is the limit of an amplifier or of a sensor, which
the data do not tell apart; rest after a reversal is play, and a slope that falls gently, as a cubic's, is saturation.
Of a drive that rests on levels, a limit is one settled output of all rises that end on its highest levels. What none
explains has a sentence, and no name. Signals are shares of their ranges.

Sources: J. von Neumann, "Distribution of the ratio of the mean square successive difference to the variance", Ann.
Math. Statist. 12 (1941) 367–395, for variances from differences; W. Kester (ed.), Data Conversion Handbook, 2005,
section 2.3, for the noise of a jittering clock.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, rank_filter
from scipy.optimize import nnls
from scipy.signal import find_peaks
from scipy.stats import linregress, theilslopes

from piezo_model.operators import play
from piezo_model.recordings import Recording
from piezo_model.units import percent, quantity
from solvers.arrays import Mask, Vector

SAMPLES, EXACT, TINY, NEAR, LIVE, TURNING, FEW, CHANCE = 50_000, 1e-9, 1e-7, 17, 0.6, 1e-3, 10, 3.0
"""Samples of the longest part that are searched; the largest difference that is rounding, and a hundred times that;
samples about one that are its neighbours; the smallest share of them that changes where neither stage nor drive rests;
the smallest step of a drive that turns; fewest events that are a rule, and the smallest ratio of their number to that
by chance."""
BRANCHES, BEYOND, FLAT, STEEP, ROUGH, ABRUPT, ONE_LEVEL, EVEN = 100, 0.05, 0.08, 0.4, 0.01, 100.0, 0.03, 0.05
"""Of a limit: most rises; smallest movement of the drive beyond it; largest slope there, as a share of that before;
smallest slope before; largest RMS error of the two lines, and smallest step of a rise; smallest χ² against cubics,
which controls lift to 13; largest deviation of the levels, which creep and ringing move; largest slope of settled
outputs plus their deviation, as a share of the movement, which controls lower to 0.09."""
LATER, ONE_SLOPE, UNEQUAL, SURE, LARGE = 1.1, 0.35, 0.03, 3.0, 0.25
"""Of a slew limit: smallest ratio of the output's rise to the drive's; largest exponent c, and largest deviation of the
slopes' logarithms; their smallest error, and smallest relative difference of the drive's steps; smallest distance of c
from 1, in its standard errors; smallest size, a share of the largest: small edges are linear."""
SHIFTS, BLOCKS, SEARCHED, SHIFTED, LOUD = 40, 16, 2000, 0.5, 2.0
"""Of lost rows: largest shift in samples, blocks, most samples that are searched, largest ratio of the squares with two
shifts to those with one, and smallest ratio of the model's error to the noise."""
RADII, KNOTS = np.arange(6) / 12.0, (0.25, 0.5, 0.75)
"""Radii of the plays for lost rows, and where their functions bend."""
GROUPS, UNEVEN, WHITE, CLEAR, LEAST_JITTER, MEDIAN = 12, 0.7, 0.25, 1.5, 0.03, 0.455
"""Of clock jitter: groups of samples of one speed; largest error of their logarithmic variances; largest mean of the
logarithmic ratio of first to third differences, which is 0 for white errors and 0.5 for jumps; smallest ratio of what a
variance that grows with the speed leaves to what one that grows with its square leaves; smallest jitter in samples; the
median of the square of a normal variable."""
SPIKE, FAR, ALONE, NOTABLE, MANY = 0.1, 4.0, -3, 0.01, 10.0
"""Smallest spike as a share of the range, and as a multiple of the 99 % quantile, since a million normal errors reach
three, and of the third largest distance near it; rank of that; smallest error that has to have a cause, as a share of
the range and as a multiple of the noise."""


@dataclass(frozen=True)
class Signals:
    """Drive, output and modelled output (N,) as shares of the ranges, the output rising with the drive."""

    u: Vector
    v: Vector
    model: Vector
    low: float
    span: float
    """Output where v = 0, and its change to v = 1, in its unit."""
    recording: Recording

    @classmethod
    def of(cls, recording: Recording, y_model: Vector, skip: int, span: float) -> "Signals":
        """Those of the longest part, after the skipped samples; the span has the sign of the gain."""
        at = max(
            (slice(max(part.start, skip), part.stop) for part in recording.parts),
            key=lambda part: part.stop - part.start,
        )
        x, y, modelled = (signal[at][:SAMPLES] for signal in (recording.x, recording.y, y_model))
        low = float(y.min() if span > 0.0 else y.max())
        return cls(
            (x - x.min()) / max(float(np.ptp(x)), np.finfo(float).tiny),
            (y - low) / span,
            (modelled - low) / span,
            low,
            span,
            recording,
        )

    @cached_property
    def noise(self) -> float:
        """RMS noise and rounding of the output, by the third differences of the error."""
        noise = np.median(np.diff(self.v - self.model, 3) ** 2) / (20.0 * MEDIAN)
        return float(np.sqrt(noise + quantum_of(self.v) ** 2 / 12.0))

    def size(self, share: float, digits: int = 2) -> str:
        """A difference of outputs in words."""
        return quantity(abs(self.span) * share, self.recording.output_unit, digits)

    def time(self, samples: float, digits: int = 2) -> str:
        """A number of samples in words."""
        return quantity(self.recording.sample_time * samples, "s", digits)


def repeated_output(s: Signals) -> str | None:
    """Exact repeats among neighbours that change, for which the next samples make up, as those of a stage that moves in
    jumps do not; without the ends of the range, which a limit repeats, and the turns of the drive, after which play
    rests."""
    step, change, by_model = (np.diff(signal, prepend=signal[:1]) for signal in (s.u, s.v, s.model))
    size, least = np.abs(change), max(1.5 * quantum_of(s.v), TINY)
    turns = (_nearby(step > TURNING) > 0.0) & (_nearby(step < -TURNING) > 0.0)
    live = (_nearby(size > least) > LIVE) & ~turns & (s.v > s.v.min() + EXACT) & (s.v < s.v.max() - EXACT)
    repeats = live & (size <= EXACT)
    count, missed = np.count_nonzero(repeats), by_model[repeats]
    by_chance = 0.5 * (np.count_nonzero(live & (size < least)) - count)  # half as many as changes by one quantum
    return (
        f"The output repeats exactly in {count} of {np.count_nonzero(live)} samples while it moves: samples are read "
        "twice."
        if count >= FEW + CHANCE * by_chance
        and missed @ np.roll(change - by_model, -1)[repeats] > 0.5 * (missed @ missed)
        else None
    )


def held_output(s: Signals) -> str | None:
    """Changes at one period, which do not follow movements of a drive that rests between them."""
    change, moves = np.abs(np.diff(s.v)), np.abs(np.diff(s.u, prepend=s.u[:1])) > EXACT
    at = np.flatnonzero(change > EXACT) + 1
    if at.size < FEW or change[at - 1].mean() < 2.0 * quantum_of(s.v):
        return None
    gaps = np.diff(at)
    period = float(gaps[gaps < 2.0 * np.quantile(gaps, 0.1)].mean())
    even = period > 1.9 and np.quantile(np.abs(gaps - period * np.round(gaps / period)), 0.99) < 1.0
    own = moves.mean() > LIVE or np.mean(np.convolve(moves, np.ones(NEAR))[at] > 0.5) < LIVE
    return (
        f"The output changes every {period:.3g} samples ({s.time(period, 3)}) only: the sensor is slower than the "
        "recorder."
        if even and own
        else None
    )


def spikes(s: Signals) -> str | None:
    """Samples of the output far from both neighbours, and from the model, on one side, by more than the drive moves
    near them, since a mode overshoots by up to a step, and nearly alone, since one that rings does not end at once."""
    apart = np.minimum(*(np.abs(signal - median_filter(signal, 3)) for signal in (s.v, s.v - s.model)))
    apart -= maximum_filter1d(np.abs(np.diff(s.u, prepend=s.u[:1])), NEAR)
    found = apart[
        apart > np.maximum(SPIKE, FAR * np.maximum(rank_filter(apart, ALONE, NEAR), np.quantile(apart, 0.99)))
    ]
    return (
        f"The output has spikes in {found.size} sample{'s' * (found.size > 1)}, of up to "
        f"{percent(100.0 * found.max())} of the range; they are counted as if the stage moved."
        if found.size
        else None
    )


def limit(s: Signals) -> str | None:
    """Rises to one side that end in a line of slope zero, at one level; of a drive that rests, of its settled outputs,
    the medians, which are limited as the output is, and which ringing does not move."""
    begins = np.flatnonzero(np.abs(np.diff(s.u, prepend=-1.0)) > EXACT)
    u, v, flat_end = s.u, s.v, _flat_end
    if begins.size * NEAR < s.u.size:
        rests = zip(s.u[begins], np.split(s.v, begins[1:]), strict=True)
        (u, v), flat_end = np.transpose([(x, np.median(rest)) for x, rest in rests if rest.size > NEAR]), _flat_levels
    for side, which in ((1.0, "rises"), (-1.0, "falls")):
        level, flat = flat_end(side * u, side * v)
        if flat > 2.0 * quantum_of(s.v):
            return (
                f"The output stops abruptly at {quantity(s.low + s.span * side * level, s.recording.output_unit, 3)} "
                f"while the drive still {which} by up to {percent(100.0 * flat)} of its range: the amplifier or the "
                "sensor is at its limit."
            )
    return None


def slew_limit(s: Signals) -> str | None:
    """Edges of large and small steps of one slope: edges of equal steps differ in other ways."""
    edges = np.reshape([*_edges(s)], (-1, 3))
    size, step, rise = edges[edges[:, 0] > LARGE * edges[:, 0].max(initial=0.0)].T
    if step.size < 2 or np.ptp(step) < UNEQUAL * step.max() or np.ptp(size) == 0.0 or np.median(rise) < 2.0:
        return None
    line, apart = linregress(np.log(size), np.log(size / rise)), size.size**0.5 * np.log(size).std()
    error = math.hypot(line.stderr, math.sqrt(UNEQUAL**2 + np.mean(1.0 / (6.0 * rise**2))) / apart)
    return (
        f"Edges of {s.size(size.min())} to {s.size(size.max())} all move at about "
        f"{s.size(0.6 * float(np.median(size / rise)) / s.recording.sample_time)} a second: the amplifier limits the "
        "slew rate."
        if 1.0 - line.slope > SURE * error and max(abs(line.slope), np.log(size / rise).std()) < ONE_SLOPE
        else None
    )


def lost_rows(s: Signals) -> str | None:
    """Where the model leaves more than noise: functions of plays of the drive before some block, and of the drive by
    another shift after it, have less than half the error of those by one shift."""
    if np.std(s.v - s.model) < LOUD * s.noise:
        return None
    at = np.arange(SHIFTS, s.u.size - SHIFTS, 1 + s.u.size // SEARCHED)
    plays = play(s.u, RADII, np.full(RADII.size, s.u[0]))[0]
    known = np.column_stack([np.ones_like(s.u), np.gradient(s.u), plays, *(np.maximum(plays - z, 0.0) for z in KNOTS)])
    rows = (np.column_stack([known[at + shift], s.v[at]]) for shift in range(-SHIFTS, SHIFTS + 1))
    grams = np.array([[block.T @ block for block in np.array_split(shifted, BLOCKS)] for shifted in rows])
    whole, until = grams.sum(axis=1), np.cumsum(grams, axis=1)[:, :-1]
    squares = _squares(until[SHIFTS] + whole[:, None] - until)
    after, block = np.unravel_index(np.argmin(squares), squares.shape)
    by = abs(int(after) - int(np.argmin(_squares(until[:, block] + whole[after] - until[after, block]))))
    return (
        f"The output shifts by {by} sample{'s' * (by > 1)} after about "
        f"{s.time(at[(block + 1) * at.size // BLOCKS])}: one of the signals has lost rows."
        if by and squares[after, block] < SHIFTED * _squares(whole).min()
        else None
    )


def clock_jitter(s: Signals) -> str | None:
    """White errors whose variance grows with the square of the speed, by medians over groups of one speed, and not with
    the speed, as where a stage moves in jumps: of these, and of a slow error, third differences are smaller than first
    ones."""
    error, fast = s.v - s.model, np.gradient(s.model)[1:-2] ** 2
    third, first = np.diff(error, 3) ** 2 / 20.0, np.diff(error)[1:-1] ** 2 / 2.0  # of the variance of white errors
    groups = np.array_split(np.argsort(fast), GROUPS)
    fast, third, first = (np.maximum([np.median(each[at]) for at in groups], EXACT**2) for each in (fast, third, first))
    fits = [nnls(np.column_stack([1.0 / third, grown / third]), np.ones(GROUPS))[0] for grown in (fast, fast**0.5)]
    left, by_jumps = (
        np.log((constant + slope * grown + EXACT**2) / third)
        for (constant, slope), grown in zip(fits, (fast, fast**0.5), strict=True)
    )
    (constant, slope), white = fits[0], np.log(first / third)[GROUPS // 2 :]
    jitter, grows = float(np.sqrt(slope / MEDIAN)), slope * fast[-1] > constant
    return (
        "The error grows with the output's speed, as if the samples' times were uncertain by "
        f"{jitter:.2g} sampling periods ({s.time(jitter)}): the clock jitters."
        if grows
        and jitter > LEAST_JITTER
        and np.abs(left).max() < UNEVEN
        and abs(white.mean()) < WHITE
        and np.mean(by_jumps**2) > CLEAR * np.mean(left**2)
        else None
    )


def unexplained(s: Signals) -> str | None:
    """An error far above the noise and the rounding of the output."""
    rms = float(np.sqrt(np.mean((s.v - s.model) ** 2)))
    return (
        f"The model leaves {percent(100.0 * rms)} of the range, {rms / s.noise:.2g} times the noise, which is none of "
        "the known faults."
        if rms > max(NOTABLE, MANY * s.noise)
        else None
    )


FAULTS: tuple[tuple[Callable[[Signals], str | None], ...], ...] = (
    (repeated_output, held_output, spikes),
    (lost_rows,),
    (limit, slew_limit),
    (clock_jitter,),
)
"""Each kind may look like a later one: an output that is ahead of its drive rests or falls before the drive turns."""


def faults_of(signals: Signals) -> list[str]:
    """The sentences of the first kind of faults that the signals show; none of a short recording."""
    kinds = ([*filter(None, (fault(signals) for fault in kind))] for kind in FAULTS if signals.u.size > 4 * SHIFTS)
    return next(filter(None, kinds), [])


def residual(columns: np.ndarray, v: Vector) -> Vector:
    """Residual (N,) of v (N,) for the best combination of the columns (N, p)."""
    return np.asarray(v - columns @ np.linalg.lstsq(columns, v, rcond=None)[0])


def _nearby(values: Vector | Mask) -> Vector:
    """Means over the neighbours of each sample."""
    return np.asarray(np.round(np.convolve(values, np.full(NEAR, 1.0 / NEAR), "same"), 9), dtype=np.float64)


def quantum_of(v: Vector) -> float:
    """Smallest distance of two values of an output."""
    return float((apart := np.diff(np.unique(v)))[apart > EXACT].min(initial=1.0))


def _squares(grams: np.ndarray) -> Vector:
    """Squares (…) that a regression leaves, the last pivots of the Gram matrices (…, p, p) of its columns and, last, of
    the output."""
    ridge = EXACT * np.trace(grams, axis1=-2, axis2=-1)[..., None, None] / grams.shape[-1]
    return np.asarray(np.linalg.cholesky(grams + ridge * np.eye(grams.shape[-1]))[..., -1, -1] ** 2)


def _rises(u: Vector) -> Iterator[slice]:
    """Those of a drive from its lowest sample between two tops to the later top."""
    padded = np.pad(u, 1, constant_values=u.min() - 1.0)
    tops = find_peaks(padded, prominence=BEYOND, plateau_size=1)[1]["left_edges"][:BRANCHES] - 1
    for before, top in pairwise((0, *tops.tolist())):
        yield slice(before + int(np.argmin(u[before : top + 1])), top + 1)


def _flat_end(u: Vector, v: Vector) -> tuple[float, float]:
    """Level and longest flat end of rises that end abruptly, at one level; zeros without them."""
    kinks = filter(None, (_kink(u[at.stop - 1] - u[at], v[at]) for at in _rises(u)))
    level, chi_square, flat = np.reshape([*kinks], (-1, 3)).T
    several = level.size > 1 or level.max(initial=-2.0) > v.max() - ONE_LEVEL
    one = several and chi_square.sum() > ABRUPT and level.std() < ONE_LEVEL
    return (float(np.median(level)), float(flat.max())) if one else (0.0, 0.0)


def _kink(t: Vector, h: Vector) -> tuple[float, float, float] | None:
    """Level, χ² against a cubic, and length of the flat end of a rise, t below its top; None without one."""
    kinks, flat_end = [], abs(h[t < 0.5 * BEYOND].mean() - h[t < BEYOND].mean()) < 0.2 * BEYOND  # of a line, 0.25
    for flat in np.geomspace(BEYOND, max(0.5 * t.max(), BEYOND), 16 * flat_end).tolist():
        near, y = t[t <= 2.0 * flat] / flat, h[t <= 2.0 * flat]
        if min(np.count_nonzero(near < 1.0), np.count_nonzero(near > 1.0)) < 4:
            continue
        lines = np.column_stack([np.ones(near.size), np.maximum(near - 1.0, 0.0), np.minimum(near, 1.0)])
        two = np.linalg.lstsq(lines, y, rcond=None)[0]
        squares = np.mean((y - lines @ two) ** 2)
        if abs(two[2]) < -FLAT * two[1] and two[1] < -STEEP * flat and squares < ROUGH**2:
            others = np.mean(residual(np.vander(near, 4), y) ** 2)
            kinks.append((float(two[0]), float(y.size * (others - squares) / (squares + EXACT**2)), flat))
    return max(kinks, key=lambda kink: kink[1], default=None)


@np.errstate(invalid="ignore")  # of the confidence limits of ``theilslopes``, which are not used
def _flat_levels(u: Vector, v: Vector) -> tuple[float, float]:
    """Level and flat end of the settled outputs of all rises, without their beginnings, where play rests; zeros if no
    end is flat. By medians, since the first rise of a stage may be another one."""
    at = np.concatenate([np.r_[rise][v[rise] > v[rise.start] + ROUGH] for rise in _rises(u)])
    u, v = u[at], v[at]
    for lower, last in pairwise(np.unique(u).tolist()):
        flat, beyond, below = u.max() - last, u >= last, (u <= last) & (u >= min(lower, 2.0 * last - u.max()))
        level = np.median(v[beyond])
        apart = np.median(np.abs(v[beyond] - level)) / max(flat, BEYOND)
        if (
            flat > BEYOND
            and apart < EVEN
            and apart + abs(theilslopes(v[beyond], u[beyond])[0]) < EVEN
            and theilslopes(v[below], u[below])[0] > STEEP
        ):
            return float(level), float(flat)
    return 0.0, 0.0


def _edges(s: Signals) -> Iterator[tuple[float, float, int]]:
    """Sizes of edges of the output, behind each of which the drive rests, the steps of the drive, and the samples from
    20 to 80 % of an edge."""
    moves = np.abs(np.diff(s.u, prepend=s.u[:1])) > 0.1 * TURNING
    begins = np.flatnonzero(moves & ~np.roll(moves, 1))
    for begin, end in pairwise((*begins.tolist(), s.u.size)):
        u, v = s.u[begin - 1 : end], s.v[begin - 1 : end]
        size = abs(float(v[-3:].mean() - v[0]))
        drive, rise = _samples_of(u), _samples_of(v)
        if size > BEYOND and not moves[end - NEAR // 2 : end].any() and rise > LATER * drive:
            yield size, abs(float(u[-1] - u[0])), rise


def _samples_of(edge: Vector) -> int:
    """Number of samples from 20 % to 80 % of an edge (N,), without those that ring around its end."""
    share = (edge - edge[0]) / (edge[-1] - edge[0] or 1.0)
    return int(np.count_nonzero(np.abs(share[: np.argmax(share > 0.8)] - 0.5) < 0.3))
