"""Trials of dynamics: forward fits of a recording with different modes, judged by data that they do not use.

A richer model is chosen only for a significant gain. The modes are kept if three conditions hold: the scan gains GAIN
of the whitened squares, and more than chance does (`resonance`); no frequency or damping is at a bound; and the squared
error on held-out blocks of three periods falls, by half for a mode of which the recording has few periods, and either
by an F test with as many degrees of freedom as there are independent samples (for a drive that excites the mode now and
then) or in the mean of its logarithm over the blocks (for one that excites it faintly all the time).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution

from piezo_model.dynamics import HIGHEST, Dynamics
from piezo_model.identification.autocorrelation import DEVIATIONS, autocorrelation_time, inverse_over
from piezo_model.identification.creep import candidate_rates
from piezo_model.identification.drive import TOO_FEW, level_count
from piezo_model.identification.dynamics_finding import RINGING, DynamicsFinding, moves_too_far
from piezo_model.identification.dynamics_parameters import LONGEST, SMALLEST_GAIN, Parameters
from piezo_model.identification.error_model import ProgramSolver, States, accumulate, counted_from, percent_of
from piezo_model.identification.forward import EXACT, Columns, ForwardFit, fit_forward
from piezo_model.identification.moving import movement
from piezo_model.identification.resonance import LEAST_DAMPED, LIGHTLY_DAMPED, MOST_DAMPED, Peak, Spectra, segment_of
from piezo_model.identification.selection import state_on, union_of, with_orders
from piezo_model.identification.start import InitialFit
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Vector

ORDERS = 20, 5
"""Orders n and m of the fits, in addition to those of the start: with too few plays, residual hysteresis is mistaken
for dynamics and shifts the frequency."""
STEPS, FOLD_STEPS, RECENTRED, EVENTS, LAG_OF_CREEP = 6, 1, 7, 50, math.sqrt(10.0)
"""Steps of a fit, and of a fit without some of the blocks; most further fits around a lightly damped mode; independent
samples to which a misfit is equivalent, however long the recording, since it follows the drive (the most with which
nine in ten delays from simulated steps, stairs, bits and chirps were within their intervals); samples by which creep
delays its share of the output in a decade with time constants of 1 to 10 samples, which the fit lacks."""
PERIODS, SHORTEST, FEW, CLEAR, CHANCE, SIGNIFICANT, HOPELESS = 3.0, 20, 16.0, 0.5, 1e-3, 4.0, 10.0
"""Periods, and fewest samples, of a held-out block; periods in a segment of the scan below which residual hysteresis
looks like a mode; largest ratio of squared errors that is clear (of a mode of few periods, or of an amplifier's lag in
place of a delay, since a smooth drive hardly distinguishes the two); significance level of the gain on held-out data,
and its smallest value in standard errors; ratio of squared errors with a mode to those without from which on no other
fit begins at that mode."""


def as_of_static(recording: Recording, dynamics: Dynamics, y: Vector) -> Recording:
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
        initial: InitialFit,
        qp_solver: ProgramSolver,
        orders: tuple[int, int] = ORDERS,
    ) -> DynamicsTrials:
        """Trials that start from the first fit of a static stage, namely of the recording filtered by an inverse, which
        may be longer than the recording."""
        # the first outputs may follow an earlier drive
        counted = counted_from(recording, initial.skip + min(int(LONGEST), (recording.length - initial.skip) // 10))
        own = initial.fit.structure
        rates = own.creep_rates or candidate_rates(recording.sample_time, recording.duration_s)
        # few levels determine no hysteresis
        s = own if 0 < level_count(recording.x) <= TOO_FEW else union_of([own, with_orders(own, *orders, rates)])
        states = [state_on(own, state, s) for state in initial.fit.states]
        problem = accumulate(initial.fit.recording.head(recording.length), counted, s, states, qp_solver)
        return cls(recording, counted, s, states, s.inverse_slope_map @ qp_solver.optimum(problem), qp_solver)

    def fit(
        self,
        parameters: Parameters,
        near: ForwardFit | None = None,
        counted: Mask | None = None,
        steps: int = STEPS,
        further: Columns | None = None,
    ) -> ForwardFit:
        """Fit all counted samples or some of them, starting from the states and weights of another fit."""
        start = self if near is None else near
        return fit_forward(
            self.recording,
            self.counted if counted is None else counted,
            self.structure,
            start.states[: len(self.recording.starts)],
            start.v,
            self.qp_solver,
            steps=steps,
            further=further,
            parameters=parameters,
        )

    def percent(self, mean_square: float) -> float:
        """The root of a mean square error in normalised units, % of the output's range."""
        return percent_of(
            float(np.ptp(self.recording.y[self.counted])), abs(self.structure.y_scale) * math.sqrt(mean_square)
        )

    def searched(
        self, parameters: Parameters, near: ForwardFit | None = None, hopeless: float = math.inf
    ) -> ForwardFit:
        """Fit, and repeat the fit from its result while that has a smaller error, which is not hopeless, but a
        frequency or a damping at a bound; more than once only for lightly damped modes, of which the scan may be far
        off between the harmonics of a drive."""
        fit, modes = self.fit(parameters, near), len(parameters.start.frequencies_Hz)
        cost = hopeless if near is None else near.cost
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

        best = self.searched(
            replace(one, start=replace(one.start, gains=(1.0,)), residual=False), hopeless=HOPELESS * none.cost
        )
        if best.cost < HOPELESS * none.cost:
            best = better(best, replace(parameters_of(best), residual=True))
        if one.residual:
            best = min(best, self.searched(one), key=lambda fit: fit.cost)
        if not none.improved_by(best, parameters_of(best).vector.size - parameters_of(none).vector.size):
            return None, None
        g = parameters_of(best).start
        if (rest := spectra.beside(g)) is not None:
            second = min(max(rest.share, SMALLEST_GAIN), 0.5)
            own = g.frequencies_Hz[0], g.damping[0], 1.0 - second - SMALLEST_GAIN
            f, zeta, gains = zip(*sorted((own, (rest.frequency_Hz, rest.damping, second))), strict=True)
            two = replace(g, frequencies_Hz=f, damping=zeta, gains=gains)
            best = better(best, replace(one, start=two, residual=True))
            if parameters_of(best).start.frequencies_Hz[1:]:
                rest = spectra.beside(parameters_of(best).start)
        return better(best, replace(parameters_of(best), with_lag=True)), rest

    def judge(
        self,
        none: ForwardFit,
        best: ForwardFit,
        gain: float,
        rest: Peak | None,
    ) -> DynamicsFinding:
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
        reasons = {
            "its frequency or damping is at a bound of the search": not np.all(best.free[d:][: 2 * modes]),
            "its frequency or damping is out of range for this sampling rate": not all(
                LEAST_DAMPED < zeta < MOST_DAMPED for zeta in g.damping
            )
            or g.frequencies_Hz[-1] * T > HIGHEST,
            "the error on held-out data does not clearly decrease": not falls,
        }
        without, behind = (self.percent(squares.sum() / count) for squares in (before, after))
        also = 0.0, 0.0
        if falls and rest is not None and (cost := self._cost_beside(best, rest)) < 0.5 * best.cost:
            also = rest.frequency_Hz, self.percent(best.cost - cost)
        reason = next((why for why, applies in reasons.items() if applies), "")
        still = tuple((f, f) for f in g.frequencies_Hz)
        moves = ((ends, 0.0) if reason else movement(best, i, T, self.fit) for i, ends in enumerate(still))
        moves_Hz, spread = zip(*moves, strict=True)
        if without**2 - behind**2 < RINGING**2 and any(map(moves_too_far, g.damping, moves_Hz)):
            # residual hysteresis looks like such a mode
            reason, moves_Hz = "it moves with the amplitude or the position", still
        # other errors hardly change from sample to sample; 20 = 1² + 3² + 3² + 1²
        noise = float(np.mean(np.concatenate([np.diff(error, 3) for error in best.errors]) ** 2)) / 20.0
        variance = best.cost / count + max(best.cost - noise, 0.0) / EVENTS
        # a delay of 0 is at its bound; its deviation is the one that it would have as a free unknown
        covariance = variance * inverse_over(best.P, best.free | (np.arange(best.free.size) >= d))[d:, d:]
        hysteresis, _, creep = (float(best.v[part].sum()) for part in self.structure.slices)
        decade = creep / (1.0 + hysteresis + len(self.structure.creep_rates) * creep)
        apart = *spread, *[decade] * modes, LAG_OF_CREEP * decade
        values = np.array([*g.frequencies_Hz, *g.damping, g.delay_s])
        wide = DEVIATIONS * np.hypot(parameters.deviations(covariance), apart) * [*values[:-1], T]
        ends = np.column_stack([np.maximum(values - wide, 0.0), values + wide]).tolist()
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

    def _cost_beside(self, fit: ForwardFit, peak: Peak) -> float:
        """Cost of a fit with the deflection of one more mode, and the same one sample later, after one step."""
        T, static = self.recording.sample_time, (fit.static[part] for part in self.recording.parts)
        late = [Dynamics((peak.frequency_Hz,), (peak.damping,), (1.0,), delay) for delay in (0.0, T)]
        signals = np.concatenate([np.column_stack([g.filter(v, T) - v for g in late]) for v in static])
        return self.fit(parameters_of(fit), fit, steps=1, further=Columns.of(signals)).cost

    def without_dynamics(self, recording: Recording, fitted: ForwardFit) -> Recording:
        """The recording, which may be longer than that of the trials, without the dynamics of a fit: with the drive
        behind the amplifier, and the output of the static part plus the equalised error."""
        known = Parameters(parameters_of(fitted).start, recording.sample_time)
        whole = replace(self, recording=recording, counted=~recording.uncounted, v=fitted.v)
        s, fit = self.structure, whole.fit(known, steps=0)
        errors = [known.start.equalised(fit.error[part], recording.sample_time) for part in recording.parts]
        y = s.y_centre + s.y_scale * (fit.static + np.concatenate(errors))
        return as_of_static(recording, known.start, y)


def parameters_of(fit: ForwardFit) -> Parameters:
    """The parameters of a fit with dynamics."""
    assert fit.parameters is not None
    return fit.parameters
