"""A lag of the output: a delay, or an amplifier of first order and a delay.

Hysteresis lags too, so the correlation of input and output determines no lag: it is an unknown of a forward fit,
together with creep and a drift.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from piezo_model.dynamics import Dynamics
from piezo_model.identification.autocorrelation import DEVIATIONS
from piezo_model.identification.dynamics_parameters import LONGEST, Parameters
from piezo_model.identification.dynamics_trials import CLEAR, DynamicsTrials, parameters_of
from piezo_model.identification.forward import Columns, ForwardFit
from piezo_model.units import quantity

DynamicsChoice = Literal["estimate", "ignore"]
LagChoice = Literal["estimate", "remove", "ignore"]

SMALLEST_LAG, GAIN, RESOLUTION, STEPS = 0.1, 0.1, 0.01, 10
"""Smallest lag in samples that is significant; smallest relative gain of the error; distance from the search limit, in
samples, at which the lag may be longer; most steps of a fit, each of which moves by about a sample."""


@dataclass(frozen=True)
class Lag:
    """The lag with the smallest error, and the RMS errors without and with it, % of the output's range."""

    samples: float
    """Delay, plus the amplifier's delay of a ramp."""
    at_most_s: float
    """Upper end of the 95 % interval."""
    amplifier_s: float
    """Time constant of the amplifier; 0 for a delay alone."""
    removed: bool
    """True if the lag is attributed to the sensor, and is not in the model."""
    in_model: bool
    error_without_lag_percent: float
    error_percent: float
    at_edge: bool
    """True at the search limit: the lag may be longer."""
    is_significant: bool

    def sentence(self, sample_time: float) -> str:
        """A sentence on the lag, and what to do about it."""
        if not self.is_significant:
            at_most = f", but may lag by up to {quantity(self.at_most_s, 's', 2)}; record steps to determine it"
            return f"The output shows no significant lag{at_most * (self.at_most_s > sample_time)}."
        samples = f"{self.samples:.2f} samples" + " or more, the search limit," * self.at_edge
        amplifier = f", of an amplifier with {quantity(self.amplifier_s, 's', 3)}" if self.amplifier_s else ""
        where = (
            "the model includes the lag"
            if self.in_model
            else "it is attributed to the sensor and not in the model, but a loop closed by the sensor has it"
            if self.removed
            else "align input and output first"
            if self.at_edge
            else "include the lag with --dynamics estimate, or remove it with --lag remove"
        )
        return (
            f"The output lags by {samples} ({quantity(self.samples * sample_time, 's', 3)}){amplifier}: the RMS error "
            f"of a first fit is {self.error_without_lag_percent:.3f} % of the range without a lag and "
            f"{self.error_percent:.3f} % with it; {where}."
        )


def fit_lag(
    trials: DynamicsTrials, begins: Sequence[Dynamics], choice: DynamicsChoice, option: LagChoice
) -> tuple[ForwardFit, Lag]:
    """The best fit from any of the initial lags, with an amplifier's lag if that is clearly better, and the lag."""
    T, drift = trials.recording.sample_time, Columns.of(trials.recording.time)

    def best_fit(parameters: Parameters, *nears: ForwardFit | None) -> ForwardFit:
        fits = (trials.fit(parameters, near, steps=STEPS, further=drift) for near in nears)
        return min(fits, key=lambda fit: fit.cost)

    lagging = min(
        (best_fit(Parameters(Dynamics((), (), (), begin.lag_s(T)), T, free=True), None) for begin in begins),
        key=lambda fit: fit.cost,
    )
    if option != "remove":
        amplifier = best_fit(Parameters(begins[0], T, free=True, with_lag=True), None, lagging)
        lagging = amplifier if amplifier.cost < CLEAR * lagging.cost else lagging
    prompt, own = best_fit(Parameters(Dynamics((), (), (), 0.0), T), None, lagging), parameters_of(lagging)
    samples = float(own.vector.sum())
    # a lag of 0 is at its bound; how long it may be is the deviation that it would have as a free unknown
    of_lags = np.arange(lagging.free.size) > trials.structure.d
    uncertainty, largest = (
        DEVIATIONS * math.sqrt(np.diag(lagging.covariance_over(free))[of_lags].max())
        for free in (lagging.free, lagging.free | of_lags)
    )
    is_significant = samples > max(SMALLEST_LAG, uncertainty) and (lagging.cost < (1.0 - GAIN) ** 2 * prompt.cost)
    at_edge = bool(own.vector.max() > LONGEST - RESOLUTION)
    certain, remove = is_significant and not at_edge, option == "remove"
    return lagging, Lag(
        samples,
        T * (samples + largest),
        own.start.amplifier_lag_s,
        certain and remove,
        certain and not remove and choice == "estimate",
        trials.percent(prompt.cost),
        trials.percent(lagging.cost),
        at_edge,
        is_significant,
    )
