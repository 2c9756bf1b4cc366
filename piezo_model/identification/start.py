"""The sign of the output, a switch-on transient, and the states before the first sample, which no recording contains.

The initial play states over their thresholds are a curve that starts at the first input, z(0) = x(0) with |dz/dr| ≤ 1:
the memory of the actuator's past. The state of a play is visible until the drive has erased it, so nearly every sample
contributes. Four curves are compared by the error of the output of their forward fits (`forward`): at rest, dz/dr = 0;
after a long ascent, −1; after a long descent, 1; and searched, with the slopes as further unknowns of the best of
these. Rest is left only for a clear gain, since one more unknown always fits a little better. Creep rests with the
plays, except where a known model is validated: there it may have been driven before, and had a level for each rate.

First samples that no start explains, as of an amplifier that was switched on, have an error far larger than all later
ones and are skipped.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3, for the memory curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    Solving,
    accumulate,
    counted_from,
)
from piezo_model.identification.forward import (
    NUDGE,
    Columns,
    ForwardFit,
    fit_forward,
    simulate,
    state_with_slopes,
)
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.simulation import Arrays
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Vector

if TYPE_CHECKING:
    from piezo_model.model import HysteresisCreepModel

CURVES = {"at rest": 0.0, "after an ascent": -1.0, "after a descent": 1.0}
"""Slopes dz/dr of the initial play states."""
GAIN = 0.1
"""Largest gain that is asked for, as a share of the cost."""
CURVE_UNKNOWNS = 3
"""Unknowns that one of three curves is worth."""
MOVED = 0.01
"""Largest range of a resting drive, as a share of its whole range."""
TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""Smallest ratio of a transient's error to the largest later one, and its smallest error as a share of the range."""
LARGER = 1.5
"""Smallest ratio of the error at the end of a transient to the largest later one."""
SPOILED = 3.0
"""Smallest ratio of the later errors of fits with and without the first samples that shows these to be a transient."""
HEAD = 200_000
"""Samples after the drive has erased the initial states that decide about the start."""
NARROWER, FLAT = 0.005, 0.1
"""Smallest narrowing of the output's range that is followed, and smallest range left, as shares of it."""
FARTHEST = 2.0
"""Largest distance of a creep state before the first sample from the play's, unit amplitudes."""
SAME = 1.001
"""Largest ratio of the error to the reported one at which the identification's initial state is kept."""


@dataclass(frozen=True)
class Prepared:
    """What precedes the choice of a model."""

    structure: ModelStructure
    """With the sign of the output, and the range of the modelled one."""
    skip: int
    state: OperatorState
    start: str
    """Key of CURVES, "searched" or "given"."""
    fit: ForwardFit


def independent_samples(error: Vector) -> float:
    """Number of independent samples in an error (N,), from its periodogram S: N_e = 4 (Σ S)² / Σ S², N for white noise.

    Examples
    --------
    >>> white = np.random.default_rng(0).normal(size=4000)
    >>> 3000 < independent_samples(white) < 4500 and independent_samples(np.cumsum(white)) < 40
    True
    """
    power = np.abs(np.fft.rfft(error - error.mean()))[1:] ** 2
    return float(max(4.0 * power.sum() ** 2 / max(float(np.sum(power**2)), 1e-300), 3.0)) if power.any() else 3.0


def clear_gain(error: Vector, unknowns: int) -> float:
    """The share of the cost of an error (N,) that further unknowns must save to be worth it."""
    independent = independent_samples(error)
    return min(GAIN, unknowns * math.log(independent) / independent)


def prepare(
    recording: Recording,
    s: ModelStructure,
    solving: Solving,
    skip: int | None = None,
    state: OperatorState | None = None,
    *,
    fit_range: bool = False,
) -> Prepared:
    """Find the sign of the output, the samples to skip, and the states before the first sample.

    By default the samples of a transient are skipped; with ``fit_range`` the output's range in the structure becomes
    that of the counted samples. IdentificationError if too few samples are left.
    """
    if state is not None:
        counted = counted_from(recording, skip or 0)
        require(recording, counted, s, skip or 0)
        fit = fit_forward(recording, counted, s, state, *_started(recording, counted, s, state, solving))
        return Prepared(s, skip or 0, state, "given", fit)
    s = _signed(recording, _ranged(recording, s, skip or 0, fit_range), skip or 0, solving)
    found = _fitted(recording, s, skip or 0, solving)
    longest = _longest_transient(recording) if skip is None else 0
    if longest:
        settled = _ranged(recording, s, longest, fit_range)
        later = _fitted(recording, settled, longest, solving)
        spoiled = abs(s.y_scale / settled.y_scale) * found.fit.error
        if skip := _transient(0.5 * spoiled, 0.5 * later.fit.error, longest):
            found = _fitted(recording, _ranged(recording, s, skip, fit_range), skip, solving)
    return _narrowed(recording, found, solving) if fit_range else found


def _started(
    recording: Recording, counted: Mask, s: ModelStructure, state: OperatorState, solving: Solving
) -> tuple[Vector, Solving]:
    """Weights of (6) in slope coordinates, with which a forward fit begins."""
    solving.passes += 1
    return s.inverse_slope_map @ solving.optimum(accumulate(recording, counted, s, state, solving.proximal)), solving


def _signed(recording: Recording, s: ModelStructure, skip: int, solving: Solving) -> ModelStructure:
    """The structure with the sign of the output that has the smaller cost (6)."""

    def cost(signed: ModelStructure) -> float:
        rest = state_with_slopes(recording, signed, 0.0)
        solving.passes += 1
        problem = accumulate(recording, counted_from(recording, skip), signed, rest, solving.proximal)
        return problem.cost(solving.optimum(problem))

    require(recording, counted_from(recording, skip), s, skip)
    return min((s, s.reversed_output()), key=cost)


def _ranged(recording: Recording, s: ModelStructure, skip: int, fit_range: bool) -> ModelStructure:
    """The structure with the range of the counted outputs."""
    require(recording, counted_from(recording, skip), s, skip)
    low, high = y_range(recording, skip)
    if not fit_range or low == high:
        return s
    return replace(s, y_centre=0.5 * (low + high), y_scale=math.copysign(0.5 * (high - low), s.y_scale))


def _narrowed(recording: Recording, found: Prepared, solving: Solving) -> Prepared:
    """The same in the range of the modelled output: noise widens that of the measured one, so that the outermost pieces
    of S⁻¹ would hardly be visited."""
    fit, s, counted = found.fit, found.structure, counted_from(recording, found.skip)
    low, high = float(fit.y_model[counted].min()), float(fit.y_model[counted].max())
    if high - low < 2.0 * FLAT or max(1.0 - high, low + 1.0) < NARROWER:
        return found
    s = replace(s, y_centre=s.y_centre + 0.5 * (low + high) * s.y_scale, y_scale=0.5 * (high - low) * s.y_scale)
    modelled = replace(recording, y=found.structure.y_centre + found.structure.y_scale * fit.y_model)
    v, _ = _started(modelled, counted, s, fit.state, solving)
    fit = fit_forward(recording, counted, s, fit.state, v, solving)
    return replace(found, structure=s, fit=fit)


def _fitted(recording: Recording, s: ModelStructure, skip: int, solving: Solving) -> Prepared:
    """The forward fit from the best start."""
    counted = counted_from(recording, skip)

    def fit(slope: float) -> ForwardFit:
        state = state_with_slopes(recording, s, slope)
        return fit_forward(recording, counted, s, state, *_started(recording, counted, s, state, solving))

    def search(best: ForwardFit) -> ForwardFit:
        return fit_forward(recording, counted, s, best.state, best.v, solving, free_start=True)

    start, best = best_start(s.n, counted, fit, search)
    return Prepared(s, skip, best.state, start, best)


def best_start(
    n: int, counted: Mask, fit: Callable[[float], ForwardFit], search: Callable[[ForwardFit], ForwardFit]
) -> tuple[str, ForwardFit]:
    """The start with the smallest error of the output, and its fit; a simpler one unless the gain is clear."""
    start, best = "at rest", fit(CURVES["at rest"])
    if not n:
        return start, best
    rest = best

    def clear(fit: ForwardFit, unknowns: int) -> bool:
        return fit.cost < (1.0 - clear_gain(fit.error[counted], unknowns)) * rest.cost

    for name, slope in [*CURVES.items()][1:]:
        other = fit(slope)
        if other.cost < best.cost and clear(other, CURVE_UNKNOWNS):
            start, best = name, other
    rest, other = best, search(best)
    if clear(other, n):
        start, best = "searched", other
    return start, best


def require(recording: Recording, counted: Mask, s: ModelStructure, skip: int) -> None:
    """Refuse a recording with too few samples, or no movement, after the skipped ones."""
    left = int(np.count_nonzero(counted))
    if left <= s.d:
        raise IdentificationError(
            f"{recording.name}: only {left} of {recording.length} samples are counted"
            f"{f' after skipping {skip}' if skip else ''}, too few for {s.d} weights"
        )
    if skip and moving_from(recording, skip) == recording.length:
        raise IdentificationError(
            f"{recording.name}: the drive does not move after the first {skip} samples, which are skipped"
        )


def moving_from(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays at rest."""
    return _covered_from(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def _covered_from(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    x = recording.x[skip:]
    covered = np.flatnonzero(np.maximum.accumulate(x) - np.minimum.accumulate(x) >= span)
    return skip + int(covered[0]) if covered.size else recording.length


def _settled_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves is independent of its initial state."""
    span = recording.x_range[1] - recording.x_range[0]
    widths = (2.0 * r * s.x_scale for r in s.play_thresholds)
    return _covered_from(recording, max((width for width in widths if width < span), default=0.0))


def head_of(recording: Recording, s: ModelStructure, skip: int = 0) -> Recording:
    """The samples that decide about the start, not counting the first ``skip``."""
    return recording.head(skip + _settled_from(recording, s) + HEAD)


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    y = recording.y[skip:]
    return float(y.min()), float(y.max())


def _longest_transient(recording: Recording) -> int:
    """Largest number of samples at the start that may be a transient; 0 if the drive does not move after them."""
    longest = int(TRANSIENT_SHARE * recording.length)
    return longest if longest and moving_from(recording, longest) < recording.length else 0


def _transient(whole: Vector, later: Vector, longest: int) -> int:
    """Number of first samples that the fit of the later ones does not describe; 0 if the fit of the whole describes
    them and all others. The errors (N,) of both are shares of one range."""
    whole, later = np.abs(whole), np.abs(later)
    spoiled = float(np.max(whole[longest:])) > SPOILED * float(np.max(later[longest:]))
    return transient_end(later, longest) if spoiled or transient_end(whole, longest) else 0


def transient_end(error: Vector, longest: int) -> int:
    """Number of samples in a transient of at most ``longest``, whose error, as a share of the range, is far larger than
    all later ones; 0 for none."""
    later = float(np.max(error[longest:]))
    if np.max(error[:longest], initial=0.0) <= max(FAR_MORE * later, NOTABLE):
        return 0
    return int(np.flatnonzero(error[:longest] > LARGER * later)[-1]) + 1


def _with_creep_levels(
    recording: Recording, counted: Mask, arrays: Arrays, found: ForwardFit, shift: Columns, solving: Solving
) -> ForwardFit:
    """The fit of known weights, those of ``arrays``, with the creep of each rate begun at a level of its own, if the
    gain is clear."""
    s, state = found.structure, found.state.copy()
    if not s.creep_rates:
        return found
    effects = []
    for rate in range(len(s.creep_rates)):
        nudged = state.copy()
        nudged.creep.reshape(-1, s.lanes)[rate, : s.n + 1] += NUDGE
        solving.passes += 1
        change = s.unit_output(simulate(s, arrays, recording, nudged, found.dynamics)) - found.y_model
        effects.append(Columns.of(change / NUDGE, -FARTHEST, FARTHEST))

    def fit(state: OperatorState, further: Columns) -> ForwardFit:
        known = None if found.dynamics is None else Parameters(found.dynamics, s.sample_time)
        return fit_forward(
            recording, counted, s, state, found.v, solving, weights_known=True, further=further, parameters=known
        )

    levels = fit(state, Columns.joined([shift, *effects])).further[1:]
    state.creep.reshape(-1, s.lanes)[:, : s.n + 1] += levels[:, None]
    other = fit(state, shift)
    clear = other.cost < (1.0 - clear_gain(found.error[counted], len(effects))) * found.cost
    return other if clear else found


def start_and_transient(model: HysteresisCreepModel, recording: Recording) -> tuple[OperatorState, int]:
    """The states before the first sample of a recording with which a model, and a constant added to it, err least, and
    the number of samples in a transient.

    The identification's states are kept if the error is as small as it was there.
    """
    s, solving = model.structure, Solving()
    head, v = head_of(recording, s), s.inverse_slope_map @ model.weights
    shift = Columns.of(np.ones(head.length))
    parameters = None if model.dynamics is None else Parameters(model.dynamics, s.sample_time)

    def fitted(skip: int) -> ForwardFit:
        counted = counted_from(head, skip)

        def fit(slope: float, state: OperatorState | None = None, free: bool = False) -> ForwardFit:
            state = state_with_slopes(head, s, slope) if state is None else state
            return fit_forward(
                head,
                counted,
                s,
                state,
                v,
                solving,
                free_start=free,
                weights_known=True,
                further=shift,
                parameters=parameters,
            )

        best = best_start(s.n, counted, fit, lambda best: fit(0.0, best.state, free=True))[1]
        return _with_creep_levels(head, counted, model.arrays, best, shift, solving)

    def error(fit: ForwardFit, skip: int) -> Vector:
        centred: Vector = 0.5 * (fit.error - np.median(fit.error[counted_from(head, skip)]))
        return centred

    longest, report = _longest_transient(head), model.report.get("fit")
    if model.start is not None and report is not None:
        counted = counted_from(head, report["skipped"])
        if counted.any():
            own = fit_forward(
                head, counted, s, model.start, v, solving, steps=0, weights_known=True, parameters=parameters
            )
            if abs(s.y_scale) * math.sqrt(own.cost) <= SAME * report["rms"]:
                skipped = transient_end(np.abs(error(own, report["skipped"])), longest) if longest else 0
                return model.start, skipped
    whole = fitted(0)
    if longest and np.max(np.abs(whole.error[:longest])) > np.max(np.abs(whole.error[longest:])):
        settled = fitted(longest)
        if skip := _transient(error(whole, 0), error(settled, longest), longest):
            return settled.state, skip
    return whole.state, 0
