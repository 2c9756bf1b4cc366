"""Dynamics of a recording: whether it has modes, or else a lag, and the recording as of a stage without them.

    scan     the mode that explains the most of the cross-spectra                      `resonance`
    start    the output through the inverse of that mode, as of a static stage         `start`
    fit      forward fits with no mode, one, one with residual compliance, two with residual compliance; then with the
             lag of an amplifier                                                        `forward`
    judge    no mode against the best of the others, on held-out data; whether the resonance moves      `moving`
    static   the output of a stage without the dynamics, where creep and orders are judged

A richer model is taken for a clear gain in the error alone. The dynamics are kept if the scan gains GAIN of the
whitened squares; the squared error on held-out blocks of three periods falls, by an F test with as many degrees of
freedom as there are independent samples (a drive that rings at some time) or in the mean of its logarithm over the
blocks (one that rings faintly all the time); and no bound holds a frequency or a damping. They stay as they are in all
that follows: beside creep of all rates they are less biased than beside that of the final model.

A stage that shows no mode may have a delay of the output, or an amplifier that lags. Hysteresis lags too, so the
correlation of input and output determines neither: they are unknowns of a forward fit, beside creep and a drift. A lag
that is significant beside few plays has to be beside many, too: what few plays leave of a loop resembles one.
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
from piezo_model.identification.dynamics_parameters import LONGEST, SMALLEST_GAIN, Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    Solving,
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

GAIN, NOTABLE = 0.02, 0.1
"""Smallest share of the whitened squares that a mode has to explain, and that at which one that is not kept is worth a
sentence."""
LEAST_DAMPED, MOST_DAMPED = 1e-3, 0.9
"""Bounds of a damping."""
SAMPLES, CHANCE, SIGNIFICANT, DELAY, WHOLE = 100_000, 1e-3, 4.0, 0.7, 0.7
"""Samples from the start that decide; largest probability of the gain on held-out data without a mode, and the smallest
gain in its standard errors; delay in samples with which fits begin, and share of the static gain below which
one begins with the residual compliance of the scan, too."""
ORDERS = 20, 5
"""Orders n and m that the fits have beside those of the start: what plays are too few for is taken for dynamics, and
moves the frequency."""
STEPS, FOLD_STEPS, PERIODS, SHORTEST, RECENTRED = 6, 1, 3.0, 20, 7
"""Steps of a fit and of one without some blocks; periods, and fewest samples, of a block; and further fits around a
lightly damped mode."""
RINGING, APART, LIGHTLY_DAMPED = 0.5, 0.1, 0.25
"""RMS of a further mode at which the model does not describe the stage, per cent of the output's range; smallest
difference of the logarithms of two frequencies; largest damping of a mode beside another, and of one that is not kept
to be worth a sentence: with more, what the hysteresis leaves is alike."""
SMALLEST_LAG, LAG_GAIN, CLEAR, RESOLUTION, LAG_STEPS = 0.1, 0.1, 0.5, 0.01, 10
"""Of a lag: the smallest in samples that is worth a sentence; smallest gain of the error; largest ratio of the squares
with that of an amplifier to those with a delay alone, which a smooth drive hardly tells apart; distance from the
longest one, in samples, at which it may be longer; most steps of its fit, of which each finds about a sample."""


@dataclass(frozen=True)
class DynamicsFinding:
    """What a recording says of structural dynamics."""

    kept: bool
    frequencies_Hz: tuple[float, ...]
    damping: tuple[float, ...]
    delay_s: float
    amplifier_lag_s: float
    intervals: dict[str, list[list[float]]]
    """Those of frequencies, damping ratios and delay at 95 %."""
    held_out_percent: tuple[float, float]
    """Errors on held-out blocks without and with the dynamics, per cent of the output's range."""
    reason: str
    """Against dynamics that were not kept; "" for others."""
    gain: float
    """Share of the whitened squares that the mode explains in the scan."""
    moves_Hz: tuple[tuple[float, float], ...]
    """Lowest and highest frequency of each mode, which differ if it depends on amplitude or position."""
    also_rings: tuple[float, float]
    """Frequency in Hz of a further mode, and RMS per cent of the output's range by which the output rings there."""

    @property
    def refusal(self) -> str | None:
        """The reason against a linear model; None without one."""
        frequency, share = self.also_rings
        if share > RINGING:
            return (
                f"the output also rings near {frequency:.3g} Hz, by {share:.2g} % of the range, and two modes do not "
                "describe it; record with a drive so smooth that it does not excite that resonance"
            )
        for zeta, (low, high) in zip(self.damping, self.moves_Hz, strict=True):
            if high - low > zeta * low:
                return (
                    f"the resonance moves from {low:.4g} to {high:.4g} Hz with the amplitude or the position, too far "
                    f"for its damping of {100.0 * zeta:.2g} % to be one of a linear stage; record with the amplitude "
                    "and at the position of use"
                )
        return None

    def sentences(self) -> Iterator[str]:
        """What a user should know."""
        notable = self.gain >= NOTABLE and self.held_out_percent[1] <= self.held_out_percent[0]
        evident = notable and max(self.damping) < LIGHTLY_DAMPED
        if self.refusal is not None or not self.kept:
            if self.refusal is None and evident:
                yield (
                    f"A faint resonance near {quantity(self.frequencies_Hz[0], 'Hz', 3)} with a damping of "
                    f"{100.0 * self.damping[0]:.2g} % is not in the model, since {self.reason}; record steps of 20 ms "
                    "to determine it."
                )
            return
        within = self.intervals["frequencies_Hz"]
        for f, zeta, (low, high), moves in zip(self.frequencies_Hz, self.damping, within, self.moves_Hz, strict=True):
            between = f" ({low:.5g} to {high:.5g} Hz)" * (f"{low:.5g}" != f"{high:.5g}")
            amplifies = f", which amplifies errors of the static part near it up to {0.5 / zeta:.2g} times"
            moving = f" It moves from {moves[0]:.5g} to {moves[1]:.5g} Hz with the amplitude or the position."
            yield (
                f"A resonance at {quantity(f, 'Hz', 5)}{between} with a damping of {100.0 * zeta:.3g} %"
                f"{amplifies * (zeta < LIGHTLY_DAMPED)}.{moving * (moves[1] - moves[0] > NOTABLE * zeta * moves[0])}"
            )
        if self.also_rings[1] > 0.0:
            yield f"The output also rings near {self.also_rings[0]:.3g} Hz, which is not in the model."
        without, behind = self.held_out_percent
        lag = f", and the amplifier lags by {quantity(self.amplifier_lag_s, 's', 3)}" * (self.amplifier_lag_s > 0.0)
        yield (
            f"The output is delayed by {quantity(self.delay_s, 's', 3)} from the end of the sampling interval{lag}; in "
            f"a first fit the error on held-out data is {behind:.3g} % of the range with the dynamics and "
            f"{without:.3g} % without."
        )


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
        """The lag in words, and what to do about it."""
        if not self.is_significant:
            clear = f"clear lag, but may have one of up to {quantity(self.at_most_s, 's', 2)}"
            perhaps = f"{clear}; record steps to determine it" if self.at_most_s > sample_time else "lag"
            return f"The output shows no {perhaps}."
        samples = f"{self.samples:.2f} samples" + " or more, the search limit," * self.at_edge
        amplifier = f", of an amplifier with {quantity(self.amplifier_s, 's', 3)}" if self.amplifier_s else ""
        where = (
            "it is in the model"
            if self.in_model
            else "it is left out as the sensor's, and a loop that the sensor closes has it"
            if self.removed
            else "align input and output first"
            if self.at_edge
            else "take it into the model with --dynamics estimate, or remove it with --lag remove"
        )
        return (
            f"The output lags by {samples} ({quantity(self.samples * sample_time, 's', 3)}){amplifier}: in a first fit "
            f"the RMS error is {self.error_without_lag_percent:.3f} % of the range without a lag and "
            f"{self.error_percent:.3f} % with it; {where}."
        )


@dataclass(frozen=True)
class StaticView:
    """A recording as of a static stage, with the start of its identification, and the dynamics behind that."""

    static: Recording
    prepared: InitialFit
    dynamics: Dynamics | None = None
    finding: DynamicsFinding | None = None
    left_out: Dynamics | None = None
    """A lag that the recording has, and the model is not to have."""
    lag: Lag | None = None
    """What a recording without a mode says of a lag; None where the drive does not move the output."""


def separate(
    recording: Recording,
    prepare: Callable[..., InitialFit],
    choice: DynamicsChoice | Dynamics,
    lag: LagChoice,
    skip: int,
    solving: Solving,
) -> StaticView:
    """Find the dynamics of a recording, of which ``skip`` samples or more are not counted; ``prepare`` starts the
    identification of a static stage, and skips the samples that it finds or is given.

    IdentificationError if given dynamics are too fast for the sampling period.
    """
    if isinstance(choice, Dynamics):
        with checks.refusing(IdentificationError, f"{recording.name}: "):
            choice.check_sample_time(recording.sample_time)
        inverse = _through_inverse(recording, choice)
        prepared = prepare(inverse)
        trials = DynamicsTrials.of(recording, inverse, prepared, solving)
        return trials.separated(recording, prepared, trials.fit(Parameters(choice, recording.sample_time)))
    separated = _with_modes(recording, prepare, skip, solving) if choice == "estimate" else None
    if separated is None or separated.dynamics is None:
        finding = None if separated is None else separated.finding
        static = StaticView(recording, prepare(recording), finding=finding)
        return static if lag == "ignore" else _with_lag(recording, static, prepare, choice, lag, solving)
    return separated


def _with_modes(
    recording: Recording, prepare: Callable[..., InitialFit], skip: int, solving: Solving
) -> StaticView | None:
    """The recording as of a stage without its modes; None if it shows none."""
    T, head = recording.sample_time, recording.head(first_motion(recording, skip) + SAMPLES)
    if segment_of(head) < SHORTEST_SEGMENT:
        return None
    spectra = Spectra(head)
    if not _is_plausible(peak := spectra.peak()):
        return None
    share = 1.0 if peak.share > WHOLE else max(peak.share, SMALLEST_GAIN)
    begin = Dynamics((peak.frequency_Hz,), (peak.damping,), (share,), DELAY * T)
    inverse = _through_inverse(recording, begin)
    prepared = prepare(inverse)
    trials = DynamicsTrials.of(head, inverse, prepared, solving)
    none = trials.fit(Parameters(Dynamics((), (), (), DELAY * T), T, free=True))
    best, rest = trials.best(none, Parameters(begin, T, free=True, residual=share < 1.0), spectra)
    if best is None:
        return None
    finding = trials.judge(none, best, peak.gain, rest)
    separated = trials.separated(recording, prepared, best) if finding.kept else StaticView(recording, prepared)
    return replace(separated, finding=finding)


def _with_lag(
    recording: Recording,
    separated: StaticView,
    prepare: Callable[..., InitialFit],
    choice: DynamicsChoice,
    option: LagChoice,
    solving: Solving,
) -> StaticView:
    """The recording as of a stage without the lag that it has, if that is to be kept in the model or removed."""
    prepared, T = separated.prepared, recording.sample_time
    head = recording.head(first_motion(recording, prepared.skip) + SAMPLES)
    trials = DynamicsTrials.of(head, head, prepared, solving, USUAL)
    signals = (signal - signal.mean() for signal in (head.y, prepared.fit.y_model[: head.length]))
    shift = int(np.argmax(correlate(*signals)[head.length - 1 :][: int(LONGEST)]))
    late, lag = trials.lag([Dynamics((), (), (), T * samples) for samples in {0, shift}], choice, option)
    if lag.is_significant:
        static = trials.without_dynamics(head, late)
        trials = DynamicsTrials.of(head, static, prepare(static, prepared.skip), solving)
        late, lag = trials.lag([found(late).start], choice, option)
    if late.P[at := trials.structure.d + 1, at] == 0.0:
        return separated
    g = found(late).start
    if not (lag.removed or lag.in_model):
        return replace(separated, left_out=g if lag.is_significant else None, lag=lag)
    static = trials.without_dynamics(recording, late)
    return StaticView(static, prepare(static, prepared.skip), g, separated.finding, lag=lag)


def _beside(spectra: Spectra, g: Dynamics) -> Peak | None:
    """The mode that explains the most beside those of G; None without one."""
    peak = spectra.peak([*zip(g.frequencies_Hz, g.damping, strict=True)])
    apart = all(abs(math.log(peak.frequency_Hz / f)) > APART for f in g.frequencies_Hz)
    return peak if apart and peak.damping < LIGHTLY_DAMPED and _is_plausible(peak) else None


def _is_plausible(peak: Peak) -> bool:
    """Whether a peak may be a mode."""
    return peak.gain > GAIN and peak.inside and LEAST_DAMPED < peak.damping < MOST_DAMPED


def _through_inverse(recording: Recording, dynamics: Dynamics) -> Recording:
    """The recording as of a stage without the dynamics: its output through the inverse of G, up to a bandwidth."""
    parts = [dynamics.anticipated(recording.y[part], recording.sample_time) for part in recording.parts]
    return _as_of_static(recording, dynamics, np.concatenate(parts))


def _as_of_static(recording: Recording, dynamics: Dynamics, y: Vector) -> Recording:
    """The recording with another output, and with the drive that the actuator receives behind the amplifier."""
    x = [dynamics.amplified(recording.x[part], recording.sample_time) for part in recording.parts]
    return replace(recording, x=np.concatenate(x), y=y, y_range=(float(y.min()), float(y.max())))


@dataclass(frozen=True)
class DynamicsTrials:
    """Forward fits of one recording with different dynamics."""

    recording: Recording
    counted: Mask
    structure: ModelStructure
    states: States
    """Those of all parts, of which the recording may have the first."""
    v: Vector
    """Weights (d,) in slope coordinates with which fits begin."""
    solving: Solving

    @classmethod
    def of(
        cls,
        recording: Recording,
        inverse: Recording,
        prepared: InitialFit,
        solving: Solving,
        orders: tuple[int, int] = ORDERS,
    ) -> DynamicsTrials:
        """From the start of a static stage, that of the recording through an inverse, of which both may be longer."""
        late = min(int(LONGEST), recording.length // 10)  # first outputs may be those of a drive from before
        own, counted = prepared.structure, counted_from(recording, prepared.skip + late)
        s = with_orders(own, *orders, own.creep_rates or candidate_rates(recording.sample_time, recording.duration_s))
        s = union_of([own, s])
        states = [state_on(own, state, s) for state in prepared.fit.states]
        began = accumulate(inverse.head(recording.length), counted, s, states, solving)
        return cls(recording, counted, s, states, s.inverse_slope_map @ solving.optimum(began), solving)

    def fit(
        self,
        parameters: Parameters,
        near: ForwardFit | None = None,
        counted: Mask | None = None,
        steps: int = STEPS,
        further: Columns | None = None,
    ) -> ForwardFit:
        """Fit from the weights of another fit, to all counted samples or some of them."""
        counted, v = self.counted if counted is None else counted, self.v if near is None else near.v
        s, states, solving = self.structure, self.states[: len(self.recording.starts)], self.solving
        return fit_forward(
            self.recording, counted, s, states, v, solving, steps=steps, further=further, parameters=parameters
        )

    def percent(self, mean_square: float) -> float:
        """The root of a mean square error in normalised units, per cent of the output's range."""
        span = float(np.ptp(self.recording.y[self.counted]))
        return percent_of(span, abs(self.structure.y_scale) * math.sqrt(mean_square))

    def searched(self, parameters: Parameters, near: ForwardFit | None = None) -> ForwardFit:
        """Fit, and once more from what was found if a bound holds a frequency or a damping of a smaller error, and so
        on while the modes are lightly damped: between the harmonics of a drive, the scan may be far from them."""
        fit, modes = self.fit(parameters, near), len(parameters.start.frequencies_Hz)
        cost = math.inf if near is None else near.cost
        for most_damped in (1.0, *[LIGHTLY_DAMPED] * RECENTRED):
            inside = np.all(fit.free[self.structure.d :][: 2 * modes])
            if inside or fit.cost >= cost or max(found(fit).start.damping) >= most_damped:
                break
            cost, fit = fit.cost, self.fit(found(fit), fit)
        return fit

    def best(self, none: ForwardFit, one: Parameters, spectra: Spectra) -> tuple[ForwardFit | None, Peak | None]:
        """The fit with the modes, residual compliance and lag that the recording clearly gains from, from one mode,
        None if one gains nothing over no mode, and a mode that the scan shows beside its own."""

        def better(best: ForwardFit, parameters: Parameters) -> ForwardFit:
            other = self.searched(parameters, best)
            inside = parameters.inside(found(other).start, other.free[self.structure.d :])
            unknowns = parameters.vector.size - found(best).vector.size
            return other if inside and best.improved_by(other, unknowns) else best

        best = self.searched(replace(one, start=replace(one.start, gains=(1.0,)), residual=False))
        best = better(best, replace(found(best), residual=True))
        if one.residual:
            best = min(best, self.searched(one), key=lambda fit: fit.cost)
        if not none.improved_by(best, found(best).vector.size - found(none).vector.size):
            return None, None
        g = found(best).start
        if (rest := _beside(spectra, g)) is not None:
            second = min(max(rest.share, SMALLEST_GAIN), 0.5)
            first = 1.0 - second - SMALLEST_GAIN
            own = (g.frequencies_Hz[0], g.damping[0], first), (rest.frequency_Hz, rest.damping, second)
            f, zeta, gains = zip(*sorted(own), strict=True)
            two = replace(g, frequencies_Hz=f, damping=zeta, gains=gains)
            best = better(best, replace(one, start=two, residual=True))
            if found(best).start.frequencies_Hz[1:]:
                rest = _beside(spectra, found(best).start)
        return better(best, replace(found(best), with_lag=True)), rest

    def lag(self, begins: Sequence[Dynamics], choice: DynamicsChoice, option: LagChoice) -> tuple[ForwardFit, Lag]:
        """The best fit from one of some lags, with that of an amplifier where it is clearly better, and the lag."""
        T, drift = self.recording.sample_time, Columns.of(np.linspace(-1.0, 1.0, self.recording.length))

        def fitted(parameters: Parameters, *nears: ForwardFit | None) -> ForwardFit:
            fits = (self.fit(parameters, near, steps=LAG_STEPS, further=drift) for near in nears)
            return min(fits, key=lambda fit: fit.cost)

        delays = [Parameters(Dynamics((), (), (), begin.lag_s(T)), T, free=True) for begin in begins]
        late = min((fitted(delay, None) for delay in delays), key=lambda fit: fit.cost)
        if option != "remove":
            slow = fitted(Parameters(begins[0], T, free=True, with_lag=True), None, late)
            late = slow if slow.cost < CLEAR * late.cost else late
        prompt, own = fitted(Parameters(Dynamics((), (), (), 0.0), T), None, late), found(late)
        samples = float(own.vector.sum())
        uncertainty = DEVIATIONS * math.sqrt(np.diag(late.covariance)[self.structure.d + 1 :].max())
        gains = late.cost < (1.0 - LAG_GAIN) ** 2 * prompt.cost
        is_significant = gains and samples > max(SMALLEST_LAG, uncertainty)
        at_edge = bool(own.vector.max() > LONGEST - RESOLUTION)
        certain, remove = is_significant and not at_edge, option == "remove"
        return late, Lag(
            samples,
            T * (samples + uncertainty),
            own.start.amplifier_lag_s,
            certain and remove,
            certain and not remove and choice == "estimate",
            self.percent(prompt.cost),
            self.percent(late.cost),
            at_edge,
            is_significant,
        )

    def judge(self, none: ForwardFit, best: ForwardFit, gain: float, rest: Peak | None) -> DynamicsFinding:
        """Decide whether the dynamics are kept."""
        g, T, count = found(best).start, self.recording.sample_time, int(np.count_nonzero(self.counted))
        block = max(SHORTEST, round(PERIODS / g.frequencies_Hz[0] / T))
        before, after = (self._held_out(each, block) for each in (none, best))
        gains = np.log(before / after)
        deviation = float(gains.std()) * math.sqrt(autocorrelation_time([gains]) / gains.size)
        independent = count / max(autocorrelation_time(each.errors) for each in (none, best))
        chance = f_distribution.sf(before.sum() / after.sum(), independent, independent)
        falls = before.sum() > after.sum() and (chance < CHANCE or gains.mean() > SIGNIFICANT * deviation)
        parameters, modes, moved = found(best), len(g.frequencies_Hz), best.free[self.structure.d :]
        own = slice(self.structure.d, None)
        deviations = parameters.deviations(best.covariance[own, own])  # 0 for parameters that are not free
        reasons = {
            "its frequency or damping reaches the bounds of the search": not np.all(moved[: 2 * modes]),
            "it is no mode within the sampling rate": not all(LEAST_DAMPED < zeta < MOST_DAMPED for zeta in g.damping)
            or g.frequencies_Hz[-1] * T > HIGHEST,
            "the error on held-out data does not fall": not falls,
        }
        without, behind = (self.percent(squares.sum() / count) for squares in (before, after))

        def beside(further: Columns, steps: int = STEPS) -> ForwardFit:
            return self.fit(parameters, best, steps=steps, further=further)

        also = 0.0, 0.0
        if falls and rest is not None and (cost := beside(_ringing(best, rest, T), 1).cost) < 0.5 * best.cost:
            also = rest.frequency_Hz, self.percent(best.cost - cost)
        reason = next((why for why, applies in reasons.items() if applies), "")
        still = (((f, f), 0.0) for f in g.frequencies_Hz)
        moves = still if reason else (movement(best, mode, T, beside) for mode in range(modes))
        moves_Hz, spread = zip(*moves, strict=True)
        deviations[:modes] = np.hypot(deviations[:modes], spread)
        values = np.array([*g.frequencies_Hz, *g.damping, g.delay_s])
        late = deviations[modes * (3 if parameters.residual else 2)]
        wide = DEVIATIONS * np.array([*values[:-1] * deviations[: 2 * modes], T * late])
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
        """Sum of squares on each block, for fits that have not used it and its like; 0 on the first block of each part,
        which all use, since it shows what rings from before."""
        number, counted = np.arange(self.recording.length) // block, self.counted
        first = np.isin(number, [number[part.start + np.argmax(counted[part])] for part in self.recording.parts])
        squares = np.zeros(self.recording.length)
        for inside in (first | (number % 2 == 0), first | (number % 2 == 1)):
            error = self.fit(found(fitted), fitted, inside & counted, FOLD_STEPS).error
            squares += np.where(counted & ~inside, error**2, 0.0)
        return np.asarray(np.bincount(number, squares) + EXACT * block)

    def separated(self, recording: Recording, prepared: InitialFit, fitted: ForwardFit) -> StaticView:
        """The recording without the dynamics of a fit, and the start with that output."""
        static = self.without_dynamics(recording, fitted)
        counted, before = counted_from(static, prepared.skip), prepared.fit
        near = prepared.structure, before.states, before.v
        settled = fit_forward(static, counted, *near, self.solving, searched=prepared.searched)
        return StaticView(static, replace(prepared, fit=settled), found(fitted).start)

    def without_dynamics(self, recording: Recording, fitted: ForwardFit) -> Recording:
        """The recording, of which the trials may be the head, with the output that the stage would have without the
        dynamics of a fit, that of the static part beside the equalised error, for the drive behind the amplifier."""
        known = Parameters(found(fitted).start, recording.sample_time)
        whole = replace(self, recording=recording, counted=~recording.uncounted)
        s, fit = self.structure, whole.fit(known, fitted, steps=0)
        errors = [known.start.equalised(fit.error[part], recording.sample_time) for part in recording.parts]
        y = s.y_centre + s.y_scale * (fit.static + np.concatenate(errors))
        return _as_of_static(recording, known.start, y)


def found(fit: ForwardFit) -> Parameters:
    """The dynamics of a fit that was made with some."""
    assert fit.parameters is not None
    return fit.parameters


def _ringing(fit: ForwardFit, peak: Peak, T: float) -> Columns:
    """The deflection by a mode, and that one sample late."""
    late = [Dynamics((peak.frequency_Hz,), (peak.damping,), (1.0,), delay) for delay in (0.0, T)]
    signals = [np.column_stack([g.filter(v, T) - v for g in late]) for v in (fit.static[part] for part in fit.parts)]
    return Columns(np.concatenate(signals), np.full(2, -np.inf), np.full(2, np.inf))
