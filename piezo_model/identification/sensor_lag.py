"""The lag of a sensor in samples, and its signal without the lag.

A sensor with a lag of L samples shows y_k = d(k − L) of the displacement d, so d at sample k is y at k + L.
The correlation of input and output does not determine L, since hysteresis lags too. But the model's output leaves −L
dŷ/dk of a lagging one, so the lag is one more column of the forward fit, and the output is advanced by what is found
until nothing is left.

Between samples the signal is interpolated by a sinc with a Kaiser window (J. F. Kaiser, "Nonrecursive digital filter
design using the I0-sinh window function", 1974) and not by a spline: halfway between samples a cubic spline keeps 75 %
of the variance of white noise, which would look like a better fit, and this kernel 96 %.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution

from piezo_model.identification.autocorrelation import DEVIATIONS
from piezo_model.identification.error_model import IdentificationError, Solving, counted_from, spans
from piezo_model.identification.forward import EXACT, Columns, ForwardFit, fit_forward
from piezo_model.identification.start import first_motion
from piezo_model.recordings import Recording
from piezo_model.units import quantity
from solvers.arrays import Vector

HALF_WIDTH = 32
"""Samples of the interpolation kernel on each side."""
KAISER_BETA = 10.0
LAG_SAMPLES = 100_000
"""Samples for the estimate of the lag."""
LONGEST_LAG = 10
"""Longest lag that is found, in samples."""
RESOLUTION = 0.01
"""Resolution of the lag in samples."""
SMALLEST = 0.1
"""Smallest lag in samples that is worth removing."""
CHANCE = 1e-3
"""Largest probability of the gain without a lag."""
ROUNDS, STEPS = 8, 2
"""Most advances of the output, and steps of the fit after each."""


@dataclass(frozen=True)
class Lag:
    """The sensor's delay that fits best, in samples, and the error of the output without and with its removal."""

    samples: float
    removed: bool
    error_percent: float
    error_without_lag_percent: float
    at_edge: bool
    """Whether the best lag is the largest tried one: it may be larger."""
    is_significant: bool
    """Whether the gain of its removal is clear."""

    def sentence(self, sample_time: float) -> str:
        """The lag in words."""
        samples = (
            f"{self.samples:.0f} samples or more, the search limit," if self.at_edge else f"{self.samples:.2f} samples"
        )
        removed = "; it was removed before the fit" * self.removed
        return (
            f"The sensor lags by {samples} ({quantity(self.samples * sample_time, 's', 3)}): the RMS error of the "
            f"output is {self.error_percent:.3f} % with the lag and {self.error_without_lag_percent:.3f} % "
            f"without{removed}."
        )

    @property
    def advice(self) -> str:
        """What to do about it; "" for nothing."""
        if self.removed:
            return "The model is without the lag of the sensor; a loop that the sensor closes has it."
        if not self.is_significant:
            return ""
        if self.at_edge:
            limit = f"{self.samples:.0f} samples, the search limit"
            return f"Align input and output first: the lag may be longer than {limit}."
        return "Remove the lag of the sensor with the option --lag remove."


def shift_output(y: Vector, lag: float) -> tuple[Vector, slice]:
    """Advance a signal (samples,) by a number of samples, of either sign.

    Returns
    -------
    values : array, shape (kept,)
        The signal at ``k + lag`` for every sample ``k`` of ``kept``.
    kept : slice
        Samples that are kept: those with :data:`HALF_WIDTH` neighbours on both sides.

    Examples
    --------
    >>> values, kept = shift_output(np.arange(200.0), 1.5)
    >>> kept, values[:2].round(3).tolist()
    (slice(30, 167, None), [31.5, 32.5])
    """
    whole = math.floor(lag)
    start, stop = max(0, HALF_WIDTH - 1 - whole), min(y.size, y.size - HALF_WIDTH - whole)
    distance = np.arange(1 - HALF_WIDTH, HALF_WIDTH + 1) - (lag - whole)
    window = np.i0(KAISER_BETA * np.sqrt(np.clip(1 - (distance / HALF_WIDTH) ** 2, 0, None)))
    kernel = np.sinc(distance) * window
    around = y[start + whole - HALF_WIDTH + 1 : stop + whole + HALF_WIDTH]
    values = np.correlate(around, kernel / kernel.sum(), mode="valid")
    return values, slice(start, stop)


def without_lag(recording: Recording, lag: float) -> Recording:
    """Return the recording with the output advanced by a lag; the samples at the ends of its parts, which lack
    neighbours, are not counted."""
    y, uncounted = np.empty(recording.length), np.ones(recording.length, dtype=bool)
    for first, last in ((part.start, part.stop) for part in spans(recording)):
        y[first:last] = np.interp(np.arange(last - first) + lag, np.arange(last - first), recording.y[first:last])
        if last - first <= 2 * HALF_WIDTH + lag:
            continue
        values, kept = shift_output(recording.y[first:last], lag)
        into = slice(first + kept.start, first + kept.start + values.size)
        y[into] = values
        uncounted[into] = recording.uncounted[into.start + round(lag) : into.stop + round(lag)]
    return replace(recording, y=y, uncounted=uncounted)


def estimate_lag(
    recording: Recording,
    fit: ForwardFit,
    skip: int,
    drift: Columns | None,
    solving: Solving,
    span: float,
    *,
    remove: bool,
) -> Lag | None:
    """Return the delay of the output with the smallest error of the output, over the same samples for all delays.

    Errors are shares of ``span``. The gain is significant if the variance of the error falls by an F test, and
    the lag exceeds its interval.

    None if the recording is too short, or the drive moves at its ends alone.
    """
    head = recording.head(first_motion(recording, skip) + LAG_SAMPLES)
    longest = min(LONGEST_LAG, (head.length - skip) // 20)
    counted = counted_from(without_lag(head, float(longest)), skip) & counted_from(without_lag(head, 0.0), skip)
    too_few = int(np.count_nonzero(counted)) <= fit.structure.d
    if too_few or not np.ptp(head.x[counted]):
        if remove:
            moves = "the drive moves too close to the ends of the recording"
            why = f"{head.length} samples are too few" if too_few else moves
            raise IdentificationError(f"{recording.name}: {why} to look for a lag")
        return None

    def fitted(lag: float, near: ForwardFit, *, search: bool) -> ForwardFit:
        columns = [] if drift is None else [Columns(drift.signals[: head.length], drift.low, drift.high)]
        if search:
            outputs = (near.y_model[part] for part in spans(head))
            lead = -np.concatenate([np.gradient(y) if y.size > 1 else np.zeros(y.size) for y in outputs])
            columns.insert(0, Columns.of(lead, -lag, longest - lag))
        further, states = Columns.joined(columns) if columns else None, fit.states[: len(head.starts)]
        advanced = without_lag(head, lag)
        return fit_forward(advanced, counted, fit.structure, states, near.v, solving, steps=STEPS, further=further)

    found = searched = lagging = fitted(0.0, fit, search=False)
    lag = 0.0
    for _ in range(ROUNDS):
        found = searched = fitted(lag, found, search=True)
        change = float(found.further[0])
        lag += change
        if abs(change) < RESOLUTION:
            break
    lag = 0.0 if lag < RESOLUTION else lag
    found = fitted(lag, found, search=False)
    scale = 100.0 * abs(fit.structure.y_scale) / span
    with_lag, without = (scale * math.sqrt(each.cost) for each in (lagging, found))
    independent, at = lagging.independent, fit.structure.d
    chance = f_distribution.sf(lagging.cost / max(found.cost, EXACT), independent, independent)
    smallest = max(SMALLEST, DEVIATIONS * math.sqrt(searched.covariance[at, at]))
    is_significant = bool(lag > smallest and chance < CHANCE)
    return Lag(lag, remove and lag > 0.0, with_lag, without, longest - lag <= RESOLUTION, is_significant)
