"""The lag of a sensor in samples, and its signal without the lag.

A sensor with a lag of L samples shows y_k = d(k − L) of the displacement d, so d at sample k is y at k + L.
The correlation of input and output does not determine L, since hysteresis lags too. But a hysteretic model fits best
without the lag, so L minimises the residual of the identification: first on an integer grid, then by Brent's golden
section and parabolas (R. P. Brent, Algorithms for Minimization without Derivatives, 1973, ch. 5) for the fraction.

Between samples the signal is interpolated by a sinc with a Kaiser window (J. F. Kaiser, "Nonrecursive digital filter
design using the I0-sinh window function", 1974) and not by a spline: halfway between samples a cubic spline keeps 75 %
of the variance of white noise, which would look like a better fit, and this kernel 96 %.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from piezo_model.data_basis import DataBasis
from piezo_model.identification.fit_report import Lag
from piezo_model.identification.fitting import IdentificationError, error_percent, filled, optimum
from piezo_model.identification.initial_state import moving_from
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

HALF_WIDTH = 32
"""Samples of the interpolation kernel on each side."""
KAISER_BETA = 10.0
LAG_SAMPLES = 100_000
"""Samples for the estimate of the lag, about a second of work."""

LONGEST_LAG = 10
"""Longest lag that is tried, in samples."""
RESOLUTION = 0.01
"""Resolution of the lag in samples."""


def minimise_over_lag(error: Callable[[float], float], longest: int, *, remove: bool = False) -> Lag:
    """Find the lag between 0 and ``longest`` samples with the smallest error.

    Parameters
    ----------
    error : callable
        Error of the identification at a lag in samples, over the same samples at every lag.
    longest : int
        Longest lag that is tried, in samples.
    remove : bool
        Whether the lag is to be removed.

    Examples
    --------
    >>> round(minimise_over_lag(lambda lag: (lag - 2.25) ** 2, 6).samples, 2)
    2.25
    """
    errors = [error(lag) for lag in range(longest + 1)]
    whole = int(np.argmin(errors))
    near = minimize_scalar(
        error,
        bounds=(max(whole - 1, 0), min(whole + 1, longest)),
        method="bounded",
        options={"xatol": RESOLUTION},
    )
    least, lag = min((errors[whole], float(whole)), (float(near.fun), float(near.x)))
    return Lag(lag, remove and lag > 0.0, errors[0], least, longest - lag <= RESOLUTION)


def shift_output(y: Vector, lag: float) -> tuple[Vector, slice]:
    """Advance a signal (samples,) by a number of samples, of either sign.

    Returns
    -------
    values : array, shape (kept,)
        The signal at ``k + lag`` for every sample ``k`` of ``kept``; NaN where the nearest sample is missing.
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
    around = filled(y)[start + whole - HALF_WIDTH + 1 : stop + whole + HALF_WIDTH]
    values = np.correlate(around, kernel / kernel.sum(), mode="valid")
    values[np.isnan(y[start + round(lag) : stop + round(lag)])] = np.nan
    return values, slice(start, stop)


def estimate_lag(
    recording: Recording, s: ModelStructure, skip: int, solver: str, state: OperatorState, proximal: float, remove: bool
) -> Lag | None:
    """Return the delay of the output with the smallest error (5) of the fit, over the same samples for all delays.

    None if the recording is too short, or the drive moves at its ends alone.
    """
    head = recording.head(moving_from(recording, skip) + LAG_SAMPLES)
    x, y = head.x, head.counted_y
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
    """Return the recording without the lag, with ``skip`` and the states at its new start."""
    x, y = recording.x, recording.counted_y
    values, kept = shift_output(y, lag)
    start = DataBasis(s, state)
    start.update(x[: kept.start], y[: kept.start], count=False)
    return (
        replace(
            Recording.from_arrays(
                x[kept],
                values,
                recording.sample_time,
                name=recording.name,
                input_unit=recording.input_unit,
                output_unit=recording.output_unit,
            ),
            units=recording.units,
        ),
        max(skip - kept.start, 0),
        start.state,
    )
