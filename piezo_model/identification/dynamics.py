"""Dynamics of a recording: modes, or else a lag, and the recording that the stage would give without them.

    scan     the mode that explains the most of the cross-spectra                       `resonance`
    start    the output filtered by the inverse of that mode, as if of a static stage   `start`
    fit      forward fits with no mode, one, one with residual compliance, two with residual compliance; then with the
             lag of an amplifier                                                         `dynamics_trials`
    judge    no mode against the best of the others, on held-out data; whether the resonance moves       `moving`
    static   the output of the stage without the dynamics, from which creep and orders are determined

The dynamics are not changed afterwards: estimated together with creep of all rates they are less biased than with the
creep of the final model. A stage without a visible mode may have a lag: a delay, or an amplifier of first order and a
delay. Hysteresis lags too, so the correlation of input and output determines no lag: it is an unknown of a forward fit,
together with creep and a drift. One that is significant with few plays has to be significant with many, since the
residual loop of too few plays looks like a lag.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.signal import correlate

from piezo_model import checks
from piezo_model.dynamics import Dynamics
from piezo_model.identification.autocorrelation import DEVIATIONS
from piezo_model.identification.drive import band_of
from piezo_model.identification.dynamics_finding import DynamicsFinding
from piezo_model.identification.dynamics_parameters import LONGEST, SMALLEST_GAIN, Parameters
from piezo_model.identification.dynamics_trials import CLEAR, DynamicsTrials, as_of_static, parameters_of
from piezo_model.identification.error_model import IdentificationError, ProgramSolver, accumulate
from piezo_model.identification.forward import EXACT, Columns, ForwardFit
from piezo_model.identification.resonance import LIGHTLY_DAMPED, SHORTEST_SEGMENT, Spectra, segment_of
from piezo_model.identification.selection import state_on
from piezo_model.identification.start import USUAL, InitialFit, first_motion
from piezo_model.recordings import Recording
from piezo_model.units import quantity

DynamicsChoice = Literal["estimate", "ignore"]
LagChoice = Literal["estimate", "remove", "ignore"]

SAMPLES, DELAY, WHOLE, EVIDENT, ALIASED = 100_000, 0.7, 0.7, 0.5, 1 / 6
"""Samples from the start that are used; initial delay in samples; share of the static gain below which one fit also
starts with the residual compliance of the scan; smallest gain in the scan of a mode that is tried without it, too, if
no fit finds it; lowest frequency of a drive in cycles a sample, above which all harmonics of hysteresis are aliased and
look like modes."""
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


@dataclass(frozen=True)
class StaticView:
    """The first fit of the recording that the stage would give without its dynamics, and the dynamics."""

    initial: InitialFit
    dynamics: Dynamics | None = None
    finding: DynamicsFinding | None = None
    left_out: Dynamics | None = None
    """A lag of the recording that is not to be in the model."""
    lag: Lag | None = None
    """The lag of a recording without a mode; None if the drive does not move the output."""

    @property
    def has_modes(self) -> bool:
        """True if the dynamics are more than a lag."""
        return self.dynamics is not None and bool(self.dynamics.frequencies_Hz)


def separate(
    recording: Recording,
    prepare: Callable[..., InitialFit],
    choice: DynamicsChoice | Dynamics,
    lag: LagChoice,
    skip: int,
    qp_solver: ProgramSolver,
) -> StaticView:
    """Find the dynamics of a recording, of which at least ``skip`` samples are not counted. ``prepare`` makes the first
    fit of a static stage, and decides which samples are skipped.

    IdentificationError if known dynamics are too fast for the sampling period.
    """
    if isinstance(choice, Dynamics):
        with checks.refusing(IdentificationError, f"{recording.name}: "):
            choice.check_sample_time(recording.sample_time)
        initial = prepare(_through_inverse(recording, choice))
        trials = DynamicsTrials.of(recording, initial, qp_solver)
        static = trials.without_dynamics(recording, trials.fit(Parameters(choice, recording.sample_time)))
        return StaticView(prepare(static, initial.skip), choice)
    plain, finding = prepare(recording), None
    if choice == "estimate":
        view, finding = _with_modes(recording, plain, prepare, skip, qp_solver)
        if view is not None:
            return view
    view = StaticView(plain, finding=finding)
    return view if lag == "ignore" else _with_lag(recording, view, prepare, choice, lag, qp_solver)


def _with_modes(
    recording: Recording, plain: InitialFit, prepare: Callable[..., InitialFit], skip: int, qp_solver: ProgramSolver
) -> tuple[StaticView | None, DynamicsFinding | None]:
    """The static view of a recording with modes, or None without them; and what the trials of modes say, if any."""
    T, head = recording.sample_time, recording.head(first_motion(recording, skip) + SAMPLES)
    if segment_of(head) < SHORTEST_SEGMENT:
        return None, None
    spectra = Spectra(head)
    peak, (lowest, highest) = spectra.peak(), band_of(head)
    if not peak.is_plausible or (peak.damping > LIGHTLY_DAMPED and peak.frequency_Hz > highest) or lowest * T > ALIASED:
        return None, None
    delay = Parameters(Dynamics((), (), (), DELAY * T), T, free=True)
    # A delay of more than a sample looks like residual compliance, so a mode that is evident may be whole in any case.
    for share in dict.fromkeys(
        [1.0 if peak.share > WHOLE else max(peak.share, SMALLEST_GAIN), *[1.0] * (peak.gain > EVIDENT)]
    ):
        begin = Dynamics((peak.frequency_Hz,), (peak.damping,), (share,), DELAY * T)
        initial = prepare(_through_inverse(recording, begin))
        trials = DynamicsTrials.of(head, initial, qp_solver)
        # the inverse of a mode that is none spoils the first fit, so that of the output itself is a start too
        states = [state_on(plain.fit.structure, state, trials.structure) for state in plain.fit.states]
        v = trials.structure.inverse_slope_map @ qp_solver.optimum(
            accumulate(head, trials.counted, trials.structure, states, qp_solver)
        )
        starts = trials, replace(trials, states=states, v=v)
        none = min((start.fit(delay) for start in starts), key=lambda fit: fit.cost)
        best, rest = trials.best(none, Parameters(begin, T, free=True, residual=share < 1.0), spectra)
        if best is not None:
            break
    else:
        return None, None
    finding = trials.judge(none, best, peak.gain, rest)
    if not finding.kept:
        return None, finding
    static = trials.without_dynamics(recording, best)
    return StaticView(prepare(static, initial.skip), parameters_of(best).start, finding), finding


def _with_lag(
    recording: Recording,
    view: StaticView,
    prepare: Callable[..., InitialFit],
    choice: DynamicsChoice,
    option: LagChoice,
    qp_solver: ProgramSolver,
) -> StaticView:
    """The static view of a recording with a lag, if the lag is to be in the model or removed."""
    initial, T = view.initial, recording.sample_time
    head = recording.head(first_motion(recording, initial.skip) + SAMPLES)
    trials = DynamicsTrials.of(head, initial, qp_solver, USUAL)
    signals = (signal - signal.mean() for signal in (head.y, initial.fit.y_model[: head.length]))
    shift = int(np.argmax(correlate(*signals)[head.length - 1 :][: int(LONGEST)]))
    late, lag = _fit_lag(trials, [Dynamics((), (), (), T * samples) for samples in {0, shift}], choice, option)
    if lag.is_significant:
        static = trials.without_dynamics(head, late)
        trials = DynamicsTrials.of(head, prepare(static, initial.skip), qp_solver)
        late, lag = _fit_lag(trials, [parameters_of(late).start], choice, option)
    if late.P[at := trials.structure.d + 1, at] <= EXACT:
        return view
    g = parameters_of(late).start
    if not (lag.removed or lag.in_model):
        return replace(view, left_out=g if lag.is_significant else None, lag=lag)
    static = trials.without_dynamics(recording, late)
    return StaticView(prepare(static, initial.skip), g, view.finding, lag=lag)


def _fit_lag(
    trials: DynamicsTrials, begins: Sequence[Dynamics], choice: DynamicsChoice, option: LagChoice
) -> tuple[ForwardFit, Lag]:
    """The best fit from any of the initial lags, with an amplifier's lag if that is clearly better, and the lag."""
    T, drift = trials.recording.sample_time, Columns.of(trials.recording.time)

    def best_fit(parameters: Parameters, *nears: ForwardFit | None) -> ForwardFit:
        return min(
            (trials.fit(parameters, near, steps=STEPS, further=drift) for near in nears), key=lambda fit: fit.cost
        )

    lagging = min(
        (best_fit(Parameters(Dynamics((), (), (), begin.lag_s(T)), T, free=True), None) for begin in begins),
        key=lambda fit: fit.cost,
    )
    if option != "remove":
        amplifier = best_fit(Parameters(begins[0], T, free=True, with_lag=True), None, lagging)
        lagging = amplifier if amplifier.cost < CLEAR * lagging.cost else lagging
    prompt, own = best_fit(Parameters(Dynamics((), (), (), 0.0), T), lagging), parameters_of(lagging)
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


def _through_inverse(recording: Recording, dynamics: Dynamics) -> Recording:
    """The recording with its output filtered by the inverse of G, up to a bandwidth."""
    return as_of_static(
        recording,
        dynamics,
        np.concatenate([dynamics.anticipated(recording.y[part], recording.sample_time) for part in recording.parts]),
    )
