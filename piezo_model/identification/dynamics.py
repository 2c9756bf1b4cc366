"""Dynamics of a recording: modes, or else a lag, and the recording that the stage would give without them.

    scan     the mode that explains the most of the cross-spectra                       `resonance`
    start    the output filtered by the inverse of that mode, as if of a static stage   `start`
    fit      forward fits with no mode, one, one with residual compliance, two with residual compliance; then with the
             lag of an amplifier                                                         `dynamics_trials`
    judge    no mode against the best of the others, on held-out data; whether the resonance moves       `moving`
    static   the output of the stage without the dynamics, from which creep and orders are determined

The dynamics are not changed afterwards: estimated together with creep of all rates they are less biased than with the
creep of the final model. A stage without a visible mode may have a lag (`lag`). One that is significant with few plays
has to be significant with many, since the residual loop of too few plays looks like a lag.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import correlate

from piezo_model import checks
from piezo_model.dynamics import Dynamics
from piezo_model.identification.drive import highest_frequency
from piezo_model.identification.dynamics_finding import DynamicsFinding
from piezo_model.identification.dynamics_parameters import LONGEST, SMALLEST_GAIN, Parameters
from piezo_model.identification.dynamics_trials import COARSE, DynamicsTrials, as_of_static, parameters_of
from piezo_model.identification.error_model import IdentificationError, ProgramSolver
from piezo_model.identification.lag import DynamicsChoice, Lag, LagChoice, fit_lag
from piezo_model.identification.resonance import LIGHTLY_DAMPED, SHORTEST_SEGMENT, Spectra, segment_of
from piezo_model.identification.start import USUAL, InitialFit, first_motion
from piezo_model.recordings import Recording

SAMPLES, DELAY, WHOLE = 100_000, 0.7, 0.7
"""Samples from the start that are used; initial delay in samples; share of the static gain below which one fit also
starts with the residual compliance of the scan."""


@dataclass(frozen=True)
class StaticView:
    """The recording that the stage would give without its dynamics, its first fit, and the dynamics."""

    static: Recording
    initial: InitialFit
    dynamics: Dynamics | None = None
    finding: DynamicsFinding | None = None
    left_out: Dynamics | None = None
    """A lag of the recording that is not to be in the model."""
    lag: Lag | None = None
    """The lag of a recording without a mode; None if the drive does not move the output."""


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
        inverse = _through_inverse(recording, choice)
        initial = prepare(inverse)
        trials = DynamicsTrials.of(recording, inverse, initial, qp_solver)
        static = trials.without_dynamics(recording, trials.fit(Parameters(choice, recording.sample_time)))
        return StaticView(static, prepare(static, initial.skip), choice)
    finding = None
    if choice == "estimate":
        view, finding = _with_modes(recording, prepare, skip, qp_solver)
        if view is not None:
            return view
    view = StaticView(recording, prepare(recording), finding=finding)
    return view if lag == "ignore" else _with_lag(recording, view, prepare, choice, lag, qp_solver)


def _with_modes(
    recording: Recording, prepare: Callable[..., InitialFit], skip: int, qp_solver: ProgramSolver
) -> tuple[StaticView | None, DynamicsFinding | None]:
    """The static view of a recording with modes, or None without them; and what the trials of modes say, if any."""
    T, head = recording.sample_time, recording.head(first_motion(recording, skip) + SAMPLES)
    if segment_of(head) < SHORTEST_SEGMENT:
        return None, None
    spectra = Spectra(head)
    peak = spectra.peak()
    if not peak.is_plausible or (peak.damping > LIGHTLY_DAMPED and peak.frequency_Hz > highest_frequency(head)):
        return None, None
    share = 1.0 if peak.share > WHOLE else max(peak.share, SMALLEST_GAIN)
    begin = Dynamics((peak.frequency_Hz,), (peak.damping,), (share,), DELAY * T)
    inverse = _through_inverse(recording, begin)
    initial = prepare(inverse)
    trials = DynamicsTrials.of(head, inverse, initial, qp_solver)
    none = trials.fit(Parameters(Dynamics((), (), (), DELAY * T), T, free=True))
    best, rest = trials.best(none, Parameters(begin, T, free=True, residual=share < 1.0), spectra)
    if best is None:
        return None, None
    finding = trials.judge(
        none,
        best,
        peak.gain,
        rest,
        lambda parameters: DynamicsTrials.of(head, inverse, initial, qp_solver, COARSE).fit(parameters),
    )
    if not finding.kept:
        return None, finding
    static = trials.without_dynamics(recording, best)
    return StaticView(static, prepare(static, initial.skip), parameters_of(best).start, finding), finding


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
    trials = DynamicsTrials.of(head, head, initial, qp_solver, USUAL)
    signals = (signal - signal.mean() for signal in (head.y, initial.fit.y_model[: head.length]))
    shift = int(np.argmax(correlate(*signals)[head.length - 1 :][: int(LONGEST)]))
    late, lag = fit_lag(trials, [Dynamics((), (), (), T * samples) for samples in {0, shift}], choice, option)
    if lag.is_significant:
        static = trials.without_dynamics(head, late)
        trials = DynamicsTrials.of(head, static, prepare(static, initial.skip), qp_solver)
        late, lag = fit_lag(trials, [parameters_of(late).start], choice, option)
    if late.P[at := trials.structure.d + 1, at] == 0.0:
        return view
    g = parameters_of(late).start
    if not (lag.removed or lag.in_model):
        return replace(view, left_out=g if lag.is_significant else None, lag=lag)
    static = trials.without_dynamics(recording, late)
    return StaticView(static, prepare(static, initial.skip), g, view.finding, lag=lag)


def _through_inverse(recording: Recording, dynamics: Dynamics) -> Recording:
    """The recording with its output filtered by the inverse of G, up to a bandwidth."""
    return as_of_static(
        recording,
        dynamics,
        np.concatenate([dynamics.anticipated(recording.y[part], recording.sample_time) for part in recording.parts]),
    )
