"""A delay of the output, or the lag of an amplifier, of a stage that shows no mode.

Hysteresis lags too, so the correlation of input and output determines neither. They are unknowns of a forward fit, as
dynamics without a mode, beside creep and a drift of the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_model.dynamics import Dynamics
from piezo_model.identification.autocorrelation import DEVIATIONS
from piezo_model.identification.dynamics import ORDERS, Separated, Trials, found
from piezo_model.identification.dynamics_parameters import LONGEST, Parameters
from piezo_model.identification.error_model import Solving
from piezo_model.identification.forward import Columns, ForwardFit
from piezo_model.identification.start import USUAL, Prepared, first_motion
from piezo_model.recordings import Recording
from piezo_model.units import quantity
from solvers.arrays import Vector

LAG_SAMPLES = 100_000
"""Samples for the estimate of the lag."""
SMALLEST = 0.1
"""Smallest lag in samples that is worth a sentence."""
GAIN = 0.1
"""Smallest gain of the error."""
CLEAR = 0.5
"""Largest ratio of the squares with an amplifier's lag to those with a delay alone at which it is one: a smooth drive
hardly tells them apart."""
RESOLUTION = 0.01
"""Distance from the longest lag, in samples, at which it may be longer."""
STEPS = 10
"""Most steps of the fit, of which each finds about a sample."""


@dataclass(frozen=True)
class Lag:
    """The lag with which a model errs least, and its errors without and with it, per cent of the output's range."""

    samples: float
    """Delay and the amplifier's delay of a ramp."""
    at_most_s: float
    """The longest lag within its interval at 95 %."""
    amplifier_s: float
    """Time constant of the amplifier; 0 for a delay alone."""
    removed: bool
    """Whether it is the sensor's, and so no part of the model."""
    in_model: bool
    error_without_lag_percent: float
    error_percent: float
    at_edge: bool
    """Whether it is the longest one tried: it may be longer."""
    is_significant: bool
    """Whether the gain is clear."""

    def sentence(self, sample_time: float) -> str:
        """The lag in words."""
        if not self.is_significant:
            clear = f"clear lag, but may have one of up to {quantity(self.at_most_s, 's', 2)}"
            perhaps = f"{clear}; record steps to determine it" if self.at_most_s > sample_time else "lag"
            return f"The output shows no {perhaps}."
        samples = f"{self.samples:.2f} samples" + " or more, the search limit," * self.at_edge
        amplifier = f", of an amplifier with {quantity(self.amplifier_s, 's', 3)}" if self.amplifier_s else ""
        where = "; it is in the model" if self.in_model else "; it is left out as the sensor's" * self.removed
        return (
            f"The output lags by {samples} ({quantity(self.samples * sample_time, 's', 3)}){amplifier}: in a first fit "
            f"the RMS error is {self.error_without_lag_percent:.3f} % of the range without a lag and "
            f"{self.error_percent:.3f} % with it{where}."
        )

    @property
    def advice(self) -> str:
        """What to do about it; "" for nothing."""
        if self.removed:
            return "The model is without the lag of the sensor; a loop that the sensor closes has it."
        if self.in_model or not self.is_significant:
            return ""
        if self.at_edge:
            limit = f"{self.samples:.0f} samples, the search limit"
            return f"Align input and output first: the lag may be longer than {limit}."
        return "Take the lag into the model with the option --dynamics estimate, or remove it with --lag remove."


@dataclass(frozen=True)
class _Fits:
    """Fits with structures of the same orders without a lag and with the best one."""

    trials: Trials
    prompt: ForwardFit
    late: ForwardFit

    @classmethod
    def of(cls, trials: Trials, begins: Sequence[Dynamics], *, delay_alone: bool) -> _Fits:
        """The best fit from one of some lags, with that of an amplifier where it is clearly better."""
        T, drift = trials.recording.sample_time, Columns.of(np.linspace(-1.0, 1.0, trials.recording.length))

        def fitted(parameters: Parameters, *nears: ForwardFit | None) -> ForwardFit:
            fits = (trials.fit(parameters, near, steps=STEPS, further=drift) for near in nears)
            return min(fits, key=lambda fit: fit.cost)

        delays = [Parameters(Dynamics((), (), (), begin.lag_s(T)), T, free=True) for begin in begins]
        late = min((fitted(delay, None) for delay in delays), key=lambda fit: fit.cost)
        if not delay_alone:
            slow = fitted(Parameters(begins[0], T, free=True, with_lag=True), None, late)
            late = slow if slow.cost < CLEAR * late.cost else late
        prompt = fitted(Parameters(Dynamics((), (), (), 0.0), T), None, late)
        return cls(trials, prompt, late)

    @property
    def samples(self) -> float:
        """The lag of a ramp."""
        return float(found(self.late).vector.sum())

    @property
    def uncertainty(self) -> float:
        """Half its interval at 95 %."""
        return DEVIATIONS * math.sqrt(np.diag(self.late.covariance)[self.trials.structure.d + 1 :].max())

    @property
    def is_significant(self) -> bool:
        """Whether the error falls clearly and the lag exceeds its interval."""
        return self.samples > max(SMALLEST, self.uncertainty) and self.late.cost < (1.0 - GAIN) ** 2 * self.prompt.cost


def separate_lag(
    recording: Recording,
    separated: Separated,
    prepare: Callable[[Recording, int], Prepared],
    solving: Solving,
    *,
    keep: bool,
    remove: bool,
) -> tuple[Separated, Lag | None]:
    """The recording as of a stage without the lag that it has, if that is to be kept in the model or removed, and the
    lag; None where the drive does not move the output.

    A lag that is significant beside few plays has to be beside many, too: what few plays leave of a loop resembles one.
    """
    prepared = separated.prepared
    head = recording.head(first_motion(recording, prepared.skip) + LAG_SAMPLES)

    def fits(static: Recording, start: Prepared, orders: tuple[int, int], *begins: Dynamics) -> _Fits:
        return _Fits.of(Trials.of(head, static, start, solving, orders), begins, delay_alone=remove)

    T, shift = head.sample_time, _best_shift(head.y, prepared.fit.y_model[: head.length])
    best = fits(head, prepared, USUAL, *(Dynamics((), (), (), T * samples) for samples in {0, shift}))
    if best.is_significant:
        static = best.trials.without_dynamics(head, best.late)
        best = fits(static, prepare(static, prepared.skip), ORDERS, found(best.late).start)
    late, at, samples, is_significant = best.late, best.trials.structure.d + 1, best.samples, best.is_significant
    if late.P[at, at] == 0.0:
        return separated, None
    at_edge = bool(found(late).vector.max() > LONGEST - RESOLUTION)
    certain = is_significant and not at_edge
    removed, in_model = certain and remove, certain and keep and not remove
    without, behind = (best.trials.percent(fit.cost) for fit in (best.prompt, late))
    amplifier_s, at_most_s = found(late).start.amplifier_lag_s, T * (samples + best.uncertainty)
    lag = Lag(samples, at_most_s, amplifier_s, removed, in_model, without, behind, at_edge, is_significant)
    if not (removed or in_model):
        return replace(separated, left_out=found(late).start if is_significant else None), lag
    static = best.trials.without_dynamics(recording, late)
    return Separated(static, prepare(static, prepared.skip), found(late).start, separated.finding), lag


def _best_shift(y: Vector, y_model: Vector) -> int:
    """Whole samples by which the output of a model (N,) is late to correlate the most with another one (N,)."""

    def correlation(samples: int) -> float:
        pair = y[samples:] - y.mean(), y_model[: y.size - samples] - y_model.mean()
        return float(pair[0] @ pair[1]) / max(float(np.linalg.norm(pair[0]) * np.linalg.norm(pair[1])), 1e-300)

    return max(range(min(int(LONGEST), y.size // 2)), key=correlation)
