"""The sign of the output, a switch-on transient, and the states before the first sample, which no recording contains.

The initial play states over their thresholds are a curve that starts at the first input, z(0) = x(0) with |dz/dr| ≤ 1:
the memory of the actuator's past. The state of a play is visible until the drive has erased it, so nearly every sample
contributes. Four curves are compared by the error of the output of their forward fits (`forward`): at rest, dz/dr = 0;
after a long ascent, −1; after a long descent, 1; and searched, with the slopes as further unknowns of the best of
these. Rest is left only for a clear gain, since one more unknown always fits a little better. Creep rests with the
plays, except where a known model is validated: there it may have been driven before, and had a level for each rate.
Every part of a recording has a start of its own.

First samples of a switch-on transient, which no start explains, have an error far larger than all later ones and are
skipped.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3, for the memory curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    Solving,
    States,
    accumulate,
    counted_from,
    one_thread,
    spans,
)
from piezo_model.identification.forward import (
    GRAM_SAMPLES,
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
SEARCHED = "searched"
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
"""Largest distance of a creep state before the first sample from the play's, normalised units."""
SAME = 1.001
"""Largest ratio of the error to the reported one at which the identification's initial state is kept."""


USUAL = 5, 3
"""Orders n and m of a first fit."""


def structure_of(recording: Recording, n: int, m: int, creep_rates: Sequence[float] = ()) -> ModelStructure:
    """Structure with a free offset over the ranges of a recording."""
    return ModelStructure.equidistant(
        n,
        m,
        recording.x_range,
        recording.y_range,
        creep_rates,
        recording.sample_time,
        offset=True,
        input_unit=recording.input_unit,
        output_unit=recording.output_unit,
    )


@dataclass(frozen=True)
class Prepared:
    """What precedes the choice of a model."""

    structure: ModelStructure
    """With the sign of the output, and the range of the modelled one."""
    skip: int
    starts: Sequence[str]
    """For each part a key of CURVES, "searched" or "given"."""
    fit: ForwardFit

    @property
    def searched(self) -> list[bool]:
        """Whether the states of each part are unknowns."""
        return [start == SEARCHED for start in self.starts]


def prepare(
    recording: Recording,
    s: ModelStructure,
    solving: Solving,
    skip: int | None = None,
    state: OperatorState | None = None,
    *,
    fit_range: bool = False,
) -> Prepared:
    """Find the sign of the output, the samples to skip, and the states before the first sample of each part.

    By default the samples of a transient are skipped; with ``fit_range`` the output's range in the structure becomes
    that of the counted samples. IdentificationError if too few samples are left.
    """
    if state is not None:
        require(recording, counted_from(recording, skip or 0), s, skip or 0)
        return _fitted(recording, s, skip or 0, solving, state)
    s = _signed(recording, _ranged(recording, s, skip or 0, fit_range), skip or 0, solving)
    single = len(recording.starts) == 1
    head = recording.head(_memory_erased_from(recording, s) + GRAM_SAMPLES) if single else recording
    found = _fitted(head, s, skip or 0, solving)
    longest = _longest_transient(head) if skip is None else 0
    if longest:
        settled = _ranged(recording, s, longest, fit_range)
        later = _fitted(head, settled, longest, solving)
        spoiled = abs(s.y_scale / settled.y_scale) * found.fit.error
        if skip := _transient(0.5 * spoiled, 0.5 * later.fit.error, longest):
            found = _fitted(head, _ranged(recording, s, skip, fit_range), skip, solving)
    if head.length < recording.length:
        counted = counted_from(recording, found.skip)
        whole = _started(recording, counted, found.fit.structure, found.fit.states, solving)
        found = replace(found, fit=whole)
    return _narrowed(recording, found, solving) if fit_range else found


def _started(recording: Recording, counted: Mask, s: ModelStructure, states: States, solving: Solving) -> ForwardFit:
    """The forward fit that begins with the weights of (6)."""
    v = s.inverse_slope_map @ solving.optimum(accumulate(recording, counted, s, states, solving))
    return fit_forward(recording, counted, s, states, v, solving)


def _signed(recording: Recording, s: ModelStructure, skip: int, solving: Solving) -> ModelStructure:
    """The structure with the sign of the output that has the smaller cost (6)."""

    def cost(signed: ModelStructure) -> float:
        rest = [state_with_slopes(sweep, signed, 0.0) for sweep in recording.sweeps()]
        problem = accumulate(recording, counted_from(recording, skip), signed, rest, solving)
        return problem.cost(solving.optimum(problem))

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
    v = s.inverse_slope_map @ solving.optimum(accumulate(modelled, counted, s, fit.states, solving))
    return replace(found, structure=s, fit=fit_forward(recording, counted, s, fit.states, v, solving))


def _fitted(
    recording: Recording, s: ModelStructure, skip: int, solving: Solving, state: OperatorState | None = None
) -> Prepared:
    """The forward fit from the best start of every part, or from given states of the first."""
    counted, sweeps = counted_from(recording, skip), list(recording.sweeps())

    def fit(slope: float) -> ForwardFit:
        first, *later = (state_with_slopes(sweep, s, slope) for sweep in sweeps)
        return _started(recording, counted, s, [state or first, *later], solving)

    def search(best: ForwardFit) -> ForwardFit:
        return fit_forward(recording, counted, s, best.states, best.v, solving, searched=[True])

    if len(sweeps) == 1:
        start, best = ("given", fit(0.0)) if state is not None else best_start(s.n, fit, search)
        return Prepared(s, skip, [start], best)
    start, best = best_start(s.n, fit)
    starts, states = [start] * len(sweeps), list(best.states)
    for i, (sweep, part) in enumerate(zip(sweeps, spans(recording), strict=True)):
        if counted[part].any():
            starts[i], own = start_of(sweep, counted[part], s, best.v, solving)
            states[i] = own.states[0]
    if state is not None:
        starts[0], states[0] = "given", state
    searched = [start == SEARCHED for start in starts]
    best = fit_forward(recording, counted, s, states, best.v, solving, searched=searched)
    return Prepared(s, skip, starts, best)


def start_of(
    part: Recording,
    counted: Mask,
    s: ModelStructure,
    v: Vector,
    solving: Solving,
    further: Columns | None = None,
    parameters: Parameters | None = None,
) -> tuple[str, ForwardFit]:
    """The best start of one part for known weights and dynamics, and the fit from there."""

    def fit(states: States, searched: Sequence[bool] = ()) -> ForwardFit:
        return fit_forward(
            part,
            counted,
            s,
            states,
            v,
            solving,
            searched=searched,
            weights_known=True,
            further=further,
            parameters=parameters,
        )

    return best_start(
        s.n, lambda slope: fit([state_with_slopes(part, s, slope)]), lambda best: fit(best.states, [True])
    )


def best_start(
    n: int, fit: Callable[[float], ForwardFit], search: Callable[[ForwardFit], ForwardFit] | None = None
) -> tuple[str, ForwardFit]:
    """The start with the smallest error of the output, and its fit; a simpler one unless the gain is clear."""
    start, best = "at rest", fit(CURVES["at rest"])
    if not n:
        return start, best
    rest = best
    for name, slope in [*CURVES.items()][1:]:
        other = fit(slope)
        if other.cost < best.cost and rest.improved_by(other, CURVE_UNKNOWNS):
            start, best = name, other
    if search is not None and best.improved_by(other := search(best), n):
        start, best = SEARCHED, other
    return start, best


def require(recording: Recording, counted: Mask, s: ModelStructure, skip: int) -> None:
    """Refuse a recording with too few samples, or no movement, after the skipped ones."""
    left = int(np.count_nonzero(counted))
    if left <= s.d:
        counted_ones = f"{left} samples" if left == recording.length else f"only {left} of {recording.length} samples"
        raise IdentificationError(
            f"{recording.name}: {counted_ones} are counted{f' after skipping {skip}' if skip else ''}, too few for "
            f"{s.d} weights"
        )
    if skip and first_motion(recording, skip) == recording.length:
        raise IdentificationError(
            f"{recording.name}: the drive does not move after the first {skip} samples, which are skipped"
        )


def first_motion(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays at rest."""
    return _index_after_travel(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def _index_after_travel(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    x = recording.x[skip:]
    covered = np.flatnonzero(np.maximum.accumulate(x) - np.minimum.accumulate(x) >= span)
    return skip + int(covered[0]) if covered.size else recording.length


def _memory_erased_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves is independent of its initial state."""
    span = recording.x_range[1] - recording.x_range[0]
    widths = (2.0 * r * s.x_scale for r in s.play_thresholds)
    return _index_after_travel(recording, max((width for width in widths if width < span), default=0.0))


def initial_segment(recording: Recording, s: ModelStructure) -> Recording:
    """The samples that decide about the start."""
    return recording.head(_memory_erased_from(recording, s) + HEAD)


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    y = recording.y[skip:]
    return float(y.min()), float(y.max())


def _longest_transient(recording: Recording) -> int:
    """Largest number of samples at the start that may be a transient; 0 if the drive does not move after them."""
    longest = int(TRANSIENT_SHARE * spans(recording)[0].stop)
    return longest if longest and first_motion(recording, longest) < recording.length else 0


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
    part: Recording,
    counted: Mask,
    arrays: Arrays,
    found: ForwardFit,
    shift: Columns,
    solving: Solving,
    parameters: Parameters | None,
) -> ForwardFit:
    """The fit of known weights, those of ``arrays``, with the creep of each rate begun at a level of its own, if the
    gain is clear."""
    s, state = found.structure, found.states[0].copy()
    if not s.creep_rates:
        return found
    effects = []
    for rate in range(len(s.creep_rates)):
        nudged = state.copy()
        nudged.creep.reshape(-1, s.lanes)[rate, : s.n + 1] += NUDGE
        solving.passes += 1
        change = s.unit_output(simulate(s, arrays, part, [nudged], found.dynamics)) - found.y_model
        effects.append(Columns.of(change / NUDGE, -FARTHEST, FARTHEST))

    def fit(further: Columns) -> ForwardFit:
        return fit_forward(
            part, counted, s, [state], found.v, solving, weights_known=True, further=further, parameters=parameters
        )

    levels = fit(Columns.joined([shift, *effects])).further[1:]
    state.creep.reshape(-1, s.lanes)[:, : s.n + 1] += levels[:, None]
    other = fit(shift)
    return other if found.improved_by(other, len(effects)) else found


def start_and_transient(model: HysteresisCreepModel, recording: Recording) -> tuple[States, int]:
    """The states before the first sample of each part of a recording with which a model, and a constant added to it,
    err least, and the number of samples in a transient.

    The identification's states are kept if the error is as small as it was there.
    """
    s, solving, report = model.structure, Solving(), model.report.get("fit")
    v, sweeps = s.inverse_slope_map @ model.weights, list(recording.sweeps())
    known, parameters = model.starts, _known(model)
    if report is not None and len(known) == len(sweeps):
        head = initial_segment(recording, s) if len(sweeps) == 1 else recording
        counted = counted_from(head, report["skipped"])
        if counted.any():
            own = fit_forward(head, counted, s, known, v, solving, steps=0, weights_known=True, parameters=parameters)
            if abs(s.y_scale) * math.sqrt(own.cost) <= SAME * report["rms"]:
                longest, error = _longest_transient(head), _centred(own, counted)
                return known, transient_end(np.abs(error), longest) if longest else 0
    states, skips = zip(*(_start_and_transient(model, sweep, v, solving) for sweep in sweeps), strict=True)
    return states, skips[0]


def _start_and_transient(
    model: HysteresisCreepModel, part: Recording, v: Vector, solving: Solving
) -> tuple[OperatorState, int]:
    """The same of one part."""
    s, parameters = model.structure, _known(model)
    head = initial_segment(part, s)
    shift, longest = Columns.of(np.ones(head.length)), _longest_transient(head)

    def fitted(skip: int) -> tuple[ForwardFit, Vector]:
        counted = counted_from(head, skip)
        best = start_of(head, counted, s, v, solving, shift, parameters)[1]
        best = _with_creep_levels(head, counted, model.arrays, best, shift, solving, parameters)
        return best, _centred(best, counted)

    whole, error = fitted(0)
    if longest and np.max(np.abs(whole.error[:longest])) > np.max(np.abs(whole.error[longest:])):
        settled, later = fitted(longest)
        if skip := _transient(error, later, longest):
            return settled.states[0], skip
    return whole.states[0], 0


def _known(model: HysteresisCreepModel) -> Parameters | None:
    return None if model.dynamics is None else Parameters(model.dynamics, model.structure.sample_time)


def _centred(fit: ForwardFit, counted: Mask) -> Vector:
    """Errors (N,) of a fit from their median, as shares of the range."""
    return np.asarray(0.5 * (fit.error - np.median(fit.error[counted])))


@one_thread
def simulated(model: HysteresisCreepModel, recording: Recording, state: OperatorState | None) -> Vector:
    """Output (N,) of a model over a recording, from the states before each part with which it errs least, or from given
    ones before the first sample."""
    model = model.at(recording.sample_time)
    s = model.structure
    recording = recording.in_units(s.input_unit, s.output_unit)
    given = [] if state is None else [state]
    if len(given) < len(recording.starts):
        given += start_and_transient(model, recording)[0][len(given) :]
    return simulate(s, model.arrays, recording, given, model.dynamics)
