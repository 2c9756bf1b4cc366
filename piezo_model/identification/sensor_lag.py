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


def minimise_over_lag(error: Callable[[float], float], longest: int, *, remove: bool = False) -> Lag:
    """Find the lag between 0 and ``longest`` samples that leaves the smallest error.

    Parameters
    ----------
    error : callable
        Error of the identification at a lag in samples, counted over the same samples at every lag.
    longest : int
        Largest lag looked at, in samples.
    remove : bool
        Whether a lag that is found is removed.

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
        The signal at ``k + lag`` for every sample ``k`` of ``kept``.
    kept : slice
        Samples that are left: all that have :data:`HALF_WIDTH` neighbours there on both sides.

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
    return np.correlate(around, kernel / kernel.sum(), mode="valid"), slice(start, stop)


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
