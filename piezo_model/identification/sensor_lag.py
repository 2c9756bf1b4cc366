"""How many samples a sensor lags behind, and its signal without that lag.

A sensor with a lag of L samples shows y_k = d(k − L) of the displacement d, so that d at the sample k is y at k + L.
Correlating input and output does not find L: hysteresis lags too. What tells them apart is that a hysteretic model fits
the output best once the lag is taken out, so L minimises the residual of the identification: an integer grid first,
then Brent's golden section and parabolas (R. P. Brent, Algorithms for Minimization without Derivatives, 1973, ch. 5)
for the fraction.

Between samples the signal is interpolated by a sinc under a Kaiser window (J. F. Kaiser, "Nonrecursive digital filter
design using the I0-sinh window function", 1974) and not by a spline: halfway between samples a cubic spline keeps 75 %
of the variance of white noise, which the residual would take for a better fit, and this kernel 96 %.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from piezo_model.data_basis import DataBasis
from piezo_model.identification.fit_report import Lag
from piezo_model.identification.fitting import IdentificationError, error_percent, optimum
from piezo_model.identification.initial_state import moving_from
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

HALF_WIDTH = 32
"""Samples that the interpolation reaches to each side."""
KAISER_BETA = 10.0
LAG_SAMPLES = 100_000
"""Samples that the lag is estimated from: enough for it, and a second of work."""

LONGEST_LAG = 10
"""Samples of lag looked for."""
RESOLUTION = 0.01
"""Fraction of a sample to which the lag is found."""


class Shifted(NamedTuple):
    """A signal without its lag, and the samples it is known at."""

    values: Vector
    kept: slice
    """``values`` belongs to ``x[kept]``; the samples before and after are trimmed, for want of neighbours."""


def minimise_over_lag(error: Callable[[float], float], max_lag: float, *, remove: bool = False) -> Lag:
    """Find the lag between 0 and ``max_lag`` samples that leaves the smallest error.

    Parameters
    ----------
    error : callable
        Error of the identification at a lag in samples. It must be counted over the same samples at every lag.
    max_lag : float
        Largest lag looked at, in samples.
    remove : bool
        Whether a lag that is found is removed.

    Raises
    ------
    ValueError
        ``max_lag`` makes no sense, or the error is not a number at some lag.

    Examples
    --------
    >>> round(minimise_over_lag(lambda lag: (lag - 2.25) ** 2, 6).samples, 2)
    2.25
    """
    if not (math.isfinite(max_lag) and max_lag >= 0):
        raise ValueError(f"max_lag must be a finite number of samples from 0 up, not {max_lag}")
    errors: dict[float, float] = {}

    def seen(lag: float) -> float:
        if lag not in errors:
            errors[lag] = float(error(lag))
            if math.isnan(errors[lag]):
                raise ValueError(f"the error is not a number at a lag of {lag:g} samples")
        return errors[lag]

    best = min(sorted({*map(float, range(math.floor(max_lag) + 1)), float(max_lag)}), key=seen)
    low, high = max(0.0, best - 1), min(float(max_lag), best + 1)
    if high > low:
        minimize_scalar(seen, bounds=(low, high), method="bounded", options={"xatol": RESOLUTION})
    lag = float(min(errors, key=seen))
    return Lag(lag, remove and lag > 0.0, errors[0.0], errors[lag], max_lag - lag <= RESOLUTION)


def shift_output(y: Vector, lag: float) -> Shifted:
    """Advance a signal by a fraction of samples.

    Parameters
    ----------
    y : array, shape (samples,)
        Signal of a sensor that lags.
    lag : float
        Samples to advance by, of either sign. Whole ones only move the samples.

    Returns
    -------
    values : array, shape (kept,)
        The signal at ``k + lag`` for every sample ``k`` of ``kept``.
    kept : slice
        Samples that are left: all that have a neighbour there, and :data:`HALF_WIDTH` to both sides for a fraction.

    Raises
    ------
    ValueError
        Nothing would be left.

    Examples
    --------
    >>> shift_output(np.arange(5.0), 2)
    Shifted(values=array([2., 3., 4.]), kept=slice(0, 3, None))
    """
    y = np.ascontiguousarray(y, dtype=np.float64)
    if y.ndim != 1:
        raise ValueError(f"the signal must be one-dimensional, not of shape {y.shape}")
    if not math.isfinite(lag):
        raise ValueError(f"the lag must be a finite number of samples, not {lag}")
    whole = math.floor(lag + 1e-9)
    fraction = max(0.0, lag - whole)
    kernel = _kernel(fraction) if fraction > 1e-9 else np.ones(1)
    before = kernel.size // 2 - 1 if kernel.size > 1 else 0  # neighbours needed before and after k + whole
    after = kernel.size - 1 - before
    start, stop = max(0, before - whole), min(y.size, y.size - after - whole)
    if stop <= start:
        raise ValueError(f"{y.size} samples are too few to be shifted by {lag:g} samples")
    values: Vector = np.correlate(y[start + whole - before : stop + whole + after], kernel, mode="valid")
    return Shifted(values, slice(start, stop))


def _kernel(fraction: float) -> Vector:
    """Weights of the neighbours −HALF_WIDTH + 1 … HALF_WIDTH for the value at ``fraction``, with sum 1."""
    distance = np.arange(1 - HALF_WIDTH, HALF_WIDTH + 1) - fraction
    window = np.i0(KAISER_BETA * np.sqrt(np.clip(1 - (distance / HALF_WIDTH) ** 2, 0, None)))
    kernel: Vector = np.sinc(distance) * window
    kernel /= kernel.sum()
    return kernel


def estimate_lag(
    recording: Recording, s: ModelStructure, skip: int, solver: str, state: OperatorState, proximal: float, remove: bool
) -> Lag | None:
    """Return the delay of the output with the smallest error (5) left after the fit, over the same samples for all.

    None where the recording is too short for it, or the drive moves at its ends alone.
    """
    x, y = next(recording.chunks(moving_from(recording, skip) + LAG_SAMPLES))
    longest = min(LONGEST_LAG, (x.size - skip) // 20)
    start, stop = max(skip, HALF_WIDTH), x.size - HALF_WIDTH - longest  # the fraction's interpolation needs neighbours
    too_few = stop - start <= s.d
    if too_few or not np.ptp(x[start:stop]):
        if remove:
            moves = "the drive moves too close to the ends of the recording"
            why = f"{x.size} samples are too few" if too_few else moves
            raise IdentificationError(f"{recording.name}: {why} to look for a lag")
        return None
    settled = DataBasis(s, state)
    settled.update(x[:start], y[:start], count=False)

    def error(lag: float) -> float:
        values, kept = shift_output(y, lag)
        basis = DataBasis(s, settled.state)
        basis.update(x[start:stop], values[start - kept.start : stop - kept.start])
        problem = basis.problem(proximal=proximal)
        return error_percent(problem, optimum(problem, solver))

    return minimise_over_lag(error, longest, remove=remove)


def without_lag(
    recording: Recording,
    s: ModelStructure,
    lag: float,
    skip: int,
    state: OperatorState,
) -> tuple[Recording, int, OperatorState]:
    """Return the recording without the lag, and what is left of ``skip`` and the states where it starts now."""
    x, y = recording.arrays()
    values, kept = shift_output(y, lag)
    start = DataBasis(s, state)
    start.update(x[: kept.start], y[: kept.start], count=False)
    return (
        Recording.from_arrays(
            x[kept],
            values,
            recording.sample_time,
            name=recording.name,
            input_unit=recording.input_unit,
            output_unit=recording.output_unit,
        ),
        max(skip - kept.start, 0),
        start.state,
    )
