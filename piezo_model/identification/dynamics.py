"""Dynamics of a recording: modes, or else a lag, and the recording that the stage would give without them.

    scan     the mode that explains the most of the cross-spectra                       `resonance`
    start    the output filtered by the inverse of that mode, as if of a static stage   `start`
    fit      forward fits with no mode, one, one with residual compliance, two with residual compliance; then with the
             lag of an amplifier                                                         `forward`
    judge    no mode against the best of the others, on held-out data; whether the resonance moves       `moving`
    static   the output of the stage without the dynamics, from which creep and orders are determined

A richer model is chosen only for a significant gain. The dynamics are kept if three conditions hold: the scan gains
GAIN of the whitened squares, and more than chance does; no frequency or damping is at a bound; and the squared error on
held-out blocks of three periods falls, by half for a mode of which the recording has few periods, and either by an F
test with as many degrees of freedom as there are independent samples (for a drive that excites the mode now and then)
or in the mean of its logarithm over the blocks (for one that excites it faintly all the time). They are not changed
afterwards: estimated together with creep of all rates they are less biased than with the creep of the final model.

A stage without a visible mode may have an output delay, or an amplifier that lags. Hysteresis lags too, so the
correlation of input and output determines neither: they are unknowns of a forward fit, together with creep and a drift.
A lag that is significant with few plays has to be significant with many, since the residual loop of too few plays looks
like a lag.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.signal import correlate
from scipy.stats import f as f_distribution

from piezo_model import checks
from piezo_model.dynamics import HIGHEST, Dynamics
from piezo_model.identification.autocorrelation import DEVIATIONS, autocorrelation_time
from piezo_model.identification.creep import candidate_rates
from piezo_model.identification.drive import TOO_FEW, level_count
from piezo_model.identification.dynamics_parameters import LONGEST, SMALLEST_GAIN, Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    ProgramSolver,
    States,
    accumulate,
    counted_from,
    percent_of,
)
from piezo_model.identification.forward import EXACT, Columns, ForwardFit, fit_forward
from piezo_model.identification.moving import movement
from piezo_model.identification.resonance import SHORTEST_SEGMENT, Peak, Spectra, segment_of
from piezo_model.identification.selection import state_on, union_of, with_orders
from piezo_model.identification.start import USUAL, InitialFit, first_motion
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import quantity
from solvers.arrays import Mask, Vector

DynamicsChoice = Literal["estimate", "ignore"]
LagChoice = Literal["estimate", "remove", "ignore"]

GAIN, CHANCE_GAIN, NOTABLE = 0.02, 36.0, 0.1
"""Smallest fraction of the whitened squares that a mode has to explain, and the same in samples: its twelve unknowns
explain twelve samples of noise, and the best of a scan three times as many; fraction from which a rejected mode is
mentioned."""
LEAST_DAMPED, MOST_DAMPED = 1e-3, 0.9
"""Bounds of a damping ratio."""
SAMPLES, CHANCE, SIGNIFICANT, DELAY, WHOLE = 100_000, 1e-3, 4.0, 0.7, 0.7
"""Samples from the start that are used; significance level of the gain on held-out data, and its smallest value in
standard errors; initial delay in samples; share of the static gain below which one fit also starts with the residual
compliance of the scan."""
ORDERS = 20, 5
"""Orders n and m of the fits, in addition to those of the start: with too few plays, residual hysteresis is mistaken
for dynamics and shifts the frequency."""
STEPS, FOLD_STEPS, PERIODS, SHORTEST, FEW, RECENTRED = 6, 1, 3.0, 20, 16.0, 7
"""Steps of a fit, and of a fit without some of the blocks; periods, and fewest samples, of a block; periods in a
segment of the scan below which residual hysteresis looks like a mode; most further fits around a lightly damped
mode."""
RINGING, APART, LIGHTLY_DAMPED = 0.5, 0.1, 0.25
"""RMS ringing of a further mode beyond which the recording is refused, % of the output's range; smallest difference of
the logarithms of two frequencies; largest damping ratio of a further mode, and of a rejected one that is mentioned,
since residual hysteresis looks like a mode with more."""
SMALLEST_LAG, LAG_GAIN, CLEAR, RESOLUTION, LAG_STEPS = 0.1, 0.1, 0.5, 0.01, 10
"""Of a lag: the smallest in samples that is significant; smallest relative gain of the error; largest ratio of the
squared errors with an amplifier's lag to those with a delay alone, since a smooth drive hardly distinguishes the two
(and of those with a mode of few periods to those without); distance from the search limit, in samples, at which the lag
may be longer; most steps of the fit, each of which moves by about a sample."""


@dataclass(frozen=True)
class DynamicsFinding:
    """What a recording says of structural dynamics."""

    kept: bool
    frequencies_Hz: tuple[float, ...]
    damping: tuple[float, ...]
    delay_s: float
    amplifier_lag_s: float
    intervals: dict[str, list[list[float]]]
    """95 % intervals of frequencies, damping ratios and delay."""
    held_out_percent: tuple[float, float]
    """RMS errors on held-out blocks without and with the dynamics, % of the output's range."""
    reason: str
    """Why the dynamics were not kept; "" if they were."""
    gain: float
    """Fraction of the whitened squares that the mode explains in the scan."""
    moves_Hz: tuple[tuple[float, float], ...]
    """Lowest and highest frequency of each mode, which differ if it depends on amplitude or position."""
    also_rings: tuple[float, float]
    """Frequency in Hz of a further mode, and its RMS ringing in % of the output's range."""

    @property
    def refusal(self) -> str | None:
        """Why linear dynamics do not describe the stage; None if they do."""
        frequency, ringing = self.also_rings
        if ringing > RINGING:
            return (
                f"the output also rings near {frequency:.3g} Hz, by {ringing:.2g} % of the range (RMS), which the "
                "modes of the model do not describe; record with a smoother drive that does not excite this resonance"
            )
        for zeta, (low, high) in zip(self.damping, self.moves_Hz, strict=True):
            if _moves_too_far(zeta, (low, high)):
                return (
                    f"the resonance moves from {low:.4g} to {high:.4g} Hz with the amplitude or the position, too far "
                    f"for a linear mode with a damping ratio of {100.0 * zeta:.2g} %; record at the amplitude and the "
                    "position of use"
                )
        return None

    def sentences(self) -> Iterator[str]:
        """What a user should know."""
        without, behind = self.held_out_percent
        if self.refusal is not None or not self.kept:
            is_evident = self.gain >= NOTABLE and behind <= without and max(self.damping) < LIGHTLY_DAMPED
            if self.refusal is None and is_evident:
                yield (
                    f"A faint resonance near {quantity(self.frequencies_Hz[0], 'Hz', 3)} with a damping ratio of "
                    f"{100.0 * self.damping[0]:.2g} % is not in the model, since {self.reason}; record steps of 20 ms "
                    "to determine it."
                )
            return
        within = self.intervals["frequencies_Hz"]
        for f, zeta, (low, high), moves in zip(self.frequencies_Hz, self.damping, within, self.moves_Hz, strict=True):
            between = f" ({low:.5g} to {high:.5g} Hz)" * (f"{low:.5g}" != f"{high:.5g}")
            amplifies = f", which amplifies errors of the static part near it by up to {0.5 / zeta:.2g} times"
            moving = f" It moves from {moves[0]:.5g} to {moves[1]:.5g} Hz with the amplitude or the position."
            yield (
                f"The stage has a resonance at {quantity(f, 'Hz', 5)}{between} with a damping ratio of "
                f"{100.0 * zeta:.3g} %{amplifies * (zeta < LIGHTLY_DAMPED)}."
                f"{moving * (moves[1] - moves[0] > NOTABLE * zeta * moves[0])}"
            )
        if self.also_rings[1] > 0.0:
            yield f"The output also rings near {self.also_rings[0]:.3g} Hz, which is not in the model."
        lag = f", and the amplifier lags by {quantity(self.amplifier_lag_s, 's', 3)}" * (self.amplifier_lag_s > 0.0)
        yield (
            f"The output is delayed by {quantity(self.delay_s, 's', 3)} from the end of the sampling interval{lag}; "
            f"the RMS error of a first fit on held-out data is {behind:.3g} % of the range with the dynamics and "
            f"{without:.3g} % without."
        )


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
            most = quantity(self.at_most_s, "s", 2)
            perhaps = f", but may lag by up to {most}; record steps to determine it" * (self.at_most_s > sample_time)
            return f"The output shows no significant lag{perhaps}."
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
    view = _with_modes(recording, prepare, skip, qp_solver) if choice == "estimate" else None
    if view is None or view.dynamics is None:
        view = StaticView(recording, prepare(recording), finding=view.finding if view else None)
        return view if lag == "ignore" else _with_lag(recording, view, prepare, choice, lag, qp_solver)
    return view


def _with_modes(
    recording: Recording, prepare: Callable[..., InitialFit], skip: int, qp_solver: ProgramSolver
) -> StaticView | None:
    """The static view of a recording with modes; None if it shows none."""
    T, head = recording.sample_time, recording.head(first_motion(recording, skip) + SAMPLES)
    if segment_of(head) < SHORTEST_SEGMENT:
        return None
    spectra = Spectra(head)
    if not _is_plausible(peak := spectra.peak(), spectra):
        return None
    share = 1.0 if peak.share > WHOLE else max(peak.share, SMALLEST_GAIN)
    begin = Dynamics((peak.frequency_Hz,), (peak.damping,), (share,), DELAY * T)
    inverse = _through_inverse(recording, begin)
    initial = prepare(inverse)
    trials = DynamicsTrials.of(head, inverse, initial, qp_solver)
    none = trials.fit(Parameters(Dynamics((), (), (), DELAY * T), T, free=True))
    best, rest = trials.best(none, Parameters(begin, T, free=True, residual=share < 1.0), spectra)
    if best is None:
        return None
    finding = trials.judge(none, best, peak.gain, rest)
    if not finding.kept:
        return StaticView(recording, initial, finding=finding)
    static = trials.without_dynamics(recording, best)
    return StaticView(static, prepare(static, initial.skip), parameters_of(best).start, finding)


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
    late, lag = trials.lag([Dynamics((), (), (), T * samples) for samples in {0, shift}], choice, option)
    if lag.is_significant:
        static = trials.without_dynamics(head, late)
        trials = DynamicsTrials.of(head, static, prepare(static, initial.skip), qp_solver)
        late, lag = trials.lag([parameters_of(late).start], choice, option)
    if late.P[at := trials.structure.d + 1, at] == 0.0:
        return view
    g = parameters_of(late).start
    if not (lag.removed or lag.in_model):
        return replace(view, left_out=g if lag.is_significant else None, lag=lag)
    static = trials.without_dynamics(recording, late)
    return StaticView(static, prepare(static, initial.skip), g, view.finding, lag=lag)


def _beside(spectra: Spectra, g: Dynamics) -> Peak | None:
    """The mode that explains the most in addition to those of G; None without one."""
    peak = spectra.peak([*zip(g.frequencies_Hz, g.damping, strict=True)])
    apart = all(abs(math.log(peak.frequency_Hz / f)) > APART for f in g.frequencies_Hz)
    return peak if apart and peak.damping < LIGHTLY_DAMPED and _is_plausible(peak, spectra) else None


def _moves_too_far(zeta: float, ends: tuple[float, float]) -> bool:
    """True if a frequency moves by more than a linear mode of this damping ratio is wide."""
    return ends[1] - ends[0] > zeta * ends[0]


def _is_plausible(peak: Peak, spectra: Spectra) -> bool:
    """True if a peak may be a mode."""
    return (
        peak.gain > max(GAIN, CHANCE_GAIN / spectra.samples)
        and peak.inside
        and LEAST_DAMPED < peak.damping < MOST_DAMPED
    )


def _through_inverse(recording: Recording, dynamics: Dynamics) -> Recording:
    """The recording with its output filtered by the inverse of G, up to a bandwidth."""
    return _as_of_static(
        recording,
        dynamics,
        np.concatenate([dynamics.anticipated(recording.y[part], recording.sample_time) for part in recording.parts]),
    )


def _as_of_static(recording: Recording, dynamics: Dynamics, y: Vector) -> Recording:
    """The recording with another output, and with the drive behind the amplifier as its input."""
    x = [dynamics.amplified(recording.x[part], recording.sample_time) for part in recording.parts]
    return replace(recording, x=np.concatenate(x), y=y, y_range=(float(y.min()), float(y.max())))


@dataclass(frozen=True)
class DynamicsTrials:
    """Forward fits of a recording with different dynamics."""

    recording: Recording
    counted: Mask
    structure: ModelStructure
    states: States
    """States before all parts, of which the recording may have only the first."""
    v: Vector
    """Initial weights (d,) in slope coordinates."""
    qp_solver: ProgramSolver

    @classmethod
    def of(
        cls,
        recording: Recording,
        inverse: Recording,
        initial: InitialFit,
        qp_solver: ProgramSolver,
        orders: tuple[int, int] = ORDERS,
    ) -> DynamicsTrials:
        """Trials that start from the first fit of a static stage, namely of the recording filtered by an inverse; both
        of these may be longer than the recording."""
        # the first outputs may follow an earlier drive
        counted = counted_from(recording, initial.skip + min(int(LONGEST), recording.length // 10))
        own = initial.structure
        rates = own.creep_rates or candidate_rates(recording.sample_time, recording.duration_s)
        # few levels determine no hysteresis
        s = own if 0 < level_count(recording.x) <= TOO_FEW else union_of([own, with_orders(own, *orders, rates)])
        states = [state_on(own, state, s) for state in initial.fit.states]
        problem = accumulate(inverse.head(recording.length), counted, s, states, qp_solver)
        return cls(recording, counted, s, states, s.inverse_slope_map @ qp_solver.optimum(problem), qp_solver)

    def fit(
        self,
        parameters: Parameters,
        near: ForwardFit | None = None,
        counted: Mask | None = None,
        steps: int = STEPS,
        further: Columns | None = None,
    ) -> ForwardFit:
        """Fit all counted samples or some of them, starting from the weights of another fit."""
        counted, v = self.counted if counted is None else counted, self.v if near is None else near.v
        s, states, qp_solver = self.structure, self.states[: len(self.recording.starts)], self.qp_solver
        return fit_forward(
            self.recording, counted, s, states, v, qp_solver, steps=steps, further=further, parameters=parameters
        )

    def percent(self, mean_square: float) -> float:
        """The root of a mean square error in normalised units, % of the output's range."""
        span = float(np.ptp(self.recording.y[self.counted]))
        return percent_of(span, abs(self.structure.y_scale) * math.sqrt(mean_square))

    def searched(self, parameters: Parameters, near: ForwardFit | None = None) -> ForwardFit:
        """Fit, and repeat the fit from its result while that has a smaller error but a frequency or a damping at a
        bound; more than once only for lightly damped modes, of which the scan may be far off between the harmonics of a
        drive."""
        fit, modes = self.fit(parameters, near), len(parameters.start.frequencies_Hz)
        cost = math.inf if near is None else near.cost
        for most_damped in (1.0, *[LIGHTLY_DAMPED] * RECENTRED):
            inside = np.all(fit.free[self.structure.d :][: 2 * modes])
            if inside or fit.cost >= cost or max(parameters_of(fit).start.damping) >= most_damped:
                break
            cost, fit = fit.cost, self.fit(parameters_of(fit), fit)
        return fit

    def best(self, none: ForwardFit, one: Parameters, spectra: Spectra) -> tuple[ForwardFit | None, Peak | None]:
        """The fit with all modes, residual compliance and lag that give a significant gain, or None if one mode gives
        none; and a further mode in the scan."""

        def better(best: ForwardFit, parameters: Parameters) -> ForwardFit:
            other = self.searched(parameters, best)
            inside = parameters.inside(parameters_of(other).start, other.free[self.structure.d :])
            unknowns = parameters.vector.size - parameters_of(best).vector.size
            return other if inside and best.improved_by(other, unknowns) else best

        best = self.searched(replace(one, start=replace(one.start, gains=(1.0,)), residual=False))
        best = better(best, replace(parameters_of(best), residual=True))
        if one.residual:
            best = min(best, self.searched(one), key=lambda fit: fit.cost)
        if not none.improved_by(best, parameters_of(best).vector.size - parameters_of(none).vector.size):
            return None, None
        g = parameters_of(best).start
        if (rest := _beside(spectra, g)) is not None:
            second = min(max(rest.share, SMALLEST_GAIN), 0.5)
            first = 1.0 - second - SMALLEST_GAIN
            own = (g.frequencies_Hz[0], g.damping[0], first), (rest.frequency_Hz, rest.damping, second)
            f, zeta, gains = zip(*sorted(own), strict=True)
            two = replace(g, frequencies_Hz=f, damping=zeta, gains=gains)
            best = better(best, replace(one, start=two, residual=True))
            if parameters_of(best).start.frequencies_Hz[1:]:
                rest = _beside(spectra, parameters_of(best).start)
        return better(best, replace(parameters_of(best), with_lag=True)), rest

    def lag(self, begins: Sequence[Dynamics], choice: DynamicsChoice, option: LagChoice) -> tuple[ForwardFit, Lag]:
        """The best fit from any of the initial lags, with an amplifier's lag if that is clearly better, and the lag."""
        T, drift = self.recording.sample_time, Columns.of(np.linspace(-1.0, 1.0, self.recording.length))

        def best_fit(parameters: Parameters, *nears: ForwardFit | None) -> ForwardFit:
            fits = (self.fit(parameters, near, steps=LAG_STEPS, further=drift) for near in nears)
            return min(fits, key=lambda fit: fit.cost)

        delays = [Parameters(Dynamics((), (), (), begin.lag_s(T)), T, free=True) for begin in begins]
        lagging = min((best_fit(delay, None) for delay in delays), key=lambda fit: fit.cost)
        if option != "remove":
            amplifier = best_fit(Parameters(begins[0], T, free=True, with_lag=True), None, lagging)
            lagging = amplifier if amplifier.cost < CLEAR * lagging.cost else lagging
        prompt, own = best_fit(Parameters(Dynamics((), (), (), 0.0), T), None, lagging), parameters_of(lagging)
        samples = float(own.vector.sum())
        uncertainty = DEVIATIONS * math.sqrt(np.diag(lagging.covariance)[self.structure.d + 1 :].max())
        is_significant = samples > max(SMALLEST_LAG, uncertainty) and (
            lagging.cost < (1.0 - LAG_GAIN) ** 2 * prompt.cost
        )
        at_edge = bool(own.vector.max() > LONGEST - RESOLUTION)
        certain, remove = is_significant and not at_edge, option == "remove"
        return lagging, Lag(
            samples,
            T * (samples + uncertainty),
            own.start.amplifier_lag_s,
            certain and remove,
            certain and not remove and choice == "estimate",
            self.percent(prompt.cost),
            self.percent(lagging.cost),
            at_edge,
            is_significant,
        )

    def judge(self, none: ForwardFit, best: ForwardFit, gain: float, rest: Peak | None) -> DynamicsFinding:
        """Decide whether to keep the dynamics."""
        g, T, count = parameters_of(best).start, self.recording.sample_time, int(np.count_nonzero(self.counted))
        block = max(SHORTEST, round(PERIODS / g.frequencies_Hz[0] / T))
        before, after = (self._held_out(fit, block) for fit in (none, best))
        gains = np.log(before / after)
        deviation = float(gains.std()) * math.sqrt(autocorrelation_time([gains]) / gains.size)
        independent = count / max(autocorrelation_time(fit.errors) for fit in (none, best))
        chance = f_distribution.sf(before.sum() / after.sum(), independent, independent)
        highest = CLEAR if g.frequencies_Hz[0] * T * segment_of(self.recording) < FEW else 1.0
        falls = after.sum() < highest * before.sum() and (chance < CHANCE or gains.mean() > SIGNIFICANT * deviation)
        d, parameters, modes = self.structure.d, parameters_of(best), len(g.frequencies_Hz)
        deviations = parameters.deviations(best.covariance[d:, d:])  # 0 for parameters that are not free
        reasons = {
            "its frequency or damping is at a bound of the search": not np.all(best.free[d:][: 2 * modes]),
            "its frequency or damping is out of range for this sampling rate": not all(
                LEAST_DAMPED < zeta < MOST_DAMPED for zeta in g.damping
            )
            or g.frequencies_Hz[-1] * T > HIGHEST,
            "the error on held-out data does not clearly decrease": not falls,
        }
        without, behind = (self.percent(squares.sum() / count) for squares in (before, after))

        def refit(further: Columns, steps: int = STEPS) -> ForwardFit:
            return self.fit(parameters, best, steps=steps, further=further)

        also = 0.0, 0.0
        if falls and rest is not None and (cost := refit(_ringing(best, rest, T), 1).cost) < 0.5 * best.cost:
            also = rest.frequency_Hz, self.percent(best.cost - cost)
        reason = next((why for why, applies in reasons.items() if applies), "")
        still = tuple((f, f) for f in g.frequencies_Hz)
        moves = [(ends, 0.0) if reason else movement(best, i, T, refit) for i, ends in enumerate(still)]
        moves_Hz, spread = zip(*moves, strict=True)
        if without**2 - behind**2 < RINGING**2 and any(map(_moves_too_far, g.damping, moves_Hz)):
            # residual hysteresis looks like such a mode
            reason, moves_Hz = "it moves with the amplitude or the position", still
        deviations[:modes] = np.hypot(deviations[:modes], spread)
        values = np.array([*g.frequencies_Hz, *g.damping, g.delay_s])
        of_delay = 3 * modes if parameters.residual else 2 * modes
        wide = DEVIATIONS * np.array([*values[:-1] * deviations[: 2 * modes], T * deviations[of_delay]])
        ends = np.column_stack([values - wide, values + wide]).tolist()
        return DynamicsFinding(
            not reason,
            g.frequencies_Hz,
            g.damping,
            g.delay_s,
            g.amplifier_lag_s,
            {"frequencies_Hz": ends[:modes], "damping": ends[modes : 2 * modes], "delay_s": ends[2 * modes :]},
            (without, behind),
            reason,
            gain,
            moves_Hz,
            also,
        )

    def _held_out(self, fitted: ForwardFit, block: int) -> Vector:
        """Sum of squares on each block, for fits to every other block without it; 0 on the first block of each part,
        which all fits use, since it shows the ringing from before."""
        number, counted = np.arange(self.recording.length) // block, self.counted
        first = np.isin(number, [number[part.start + np.argmax(counted[part])] for part in self.recording.parts])
        squares = np.zeros(self.recording.length)
        for inside in (first | (number % 2 == 0), first | (number % 2 == 1)):
            error = self.fit(parameters_of(fitted), fitted, inside & counted, FOLD_STEPS).error
            squares += np.where(counted & ~inside, error**2, 0.0)
        return np.asarray(np.bincount(number, squares) + EXACT * block)

    def without_dynamics(self, recording: Recording, fitted: ForwardFit) -> Recording:
        """The recording, which may be longer than that of the trials, without the dynamics of a fit: with the drive
        behind the amplifier, and the output of the static part plus the equalised error."""
        known = Parameters(parameters_of(fitted).start, recording.sample_time)
        whole = replace(self, recording=recording, counted=~recording.uncounted)
        s, fit = self.structure, whole.fit(known, fitted, steps=0)
        errors = [known.start.equalised(fit.error[part], recording.sample_time) for part in recording.parts]
        y = s.y_centre + s.y_scale * (fit.static + np.concatenate(errors))
        return _as_of_static(recording, known.start, y)


def parameters_of(fit: ForwardFit) -> Parameters:
    """The parameters of a fit with dynamics."""
    assert fit.parameters is not None
    return fit.parameters


def _ringing(fit: ForwardFit, peak: Peak, T: float) -> Columns:
    """The deflection of a mode, and the same one sample later."""
    late = [Dynamics((peak.frequency_Hz,), (peak.damping,), (1.0,), delay) for delay in (0.0, T)]
    static = (fit.static[part] for part in fit.recording.parts)
    signals = [np.column_stack([g.filter(v, T) - v for g in late]) for v in static]
    return Columns(np.concatenate(signals), np.full(2, -np.inf), np.full(2, np.inf))
