"""The sign of the output, a switch-on transient, and the states before the first sample, which no recording contains.

The initial states of a part are a memory curve. The state of a play is visible until the drive has
erased it, so nearly every sample contributes. Four curves are compared by the error of the output of their forward fits
(`forward`): at rest, dz/dr = 0; after a long ascent, −1; after a long descent, 1; and searched, with the slopes as
further unknowns of the best of these. Rest is left only for a clear gain, since one more unknown always fits a little
better. Creep rests with the plays. Samples of a transient are skipped: first samples that no start explains, whose
error is far larger than all later ones.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    Solving,
    States,
    accumulate,
    counted_from,
)
from piezo_model.identification.forward import Columns, ForwardFit, fit_forward, state_with_slopes
from piezo_model.identification.gram_matrix import GRAM_SAMPLES
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Vector

CURVES = {"at rest": 0.0, "after an ascent": -1.0, "after a descent": 1.0}
"""Slopes dz/dr of the initial play states."""
SEARCHED = "searched"
CURVE_UNKNOWNS = 3
"""Unknowns that one of three curves is worth."""
HEAD = 200_000
"""Samples after the drive has erased the initial states that decide about the start."""
NARROWER, FLAT, MOVED = 0.005, 0.1, 0.01
"""Smallest narrowing of the output's range that is followed, smallest range left, and largest range of a drive that
rests, as shares of the whole ranges."""
USUAL = 5, 3
"""Orders n and m of a first fit."""
TRANSIENT_SHARE, FAR_MORE, NOTABLE, LARGER, SPOILED = 0.1, 4.0, 0.03, 1.5, 3.0
"""Of a transient: longest one, as a share of the recording; smallest ratio of its error to the largest later one, and
its smallest error as a share of the range; smallest such ratio at its end; smallest ratio of the later errors of fits
with and without the first samples that shows these to be one."""


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
class InitialFit:
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
) -> InitialFit:
    """Find the sign of the output, the samples to skip, and the states before the first sample of each part.

    By default the samples of a transient are skipped; with ``fit_range`` the output's range in the structure becomes
    that of the counted samples. IdentificationError if too few samples are left.
    """
    if state is not None:
        require(recording, counted_from(recording, skip or 0), s, skip or 0)
        return _fitted(recording, s, skip or 0, solving, state)
    s = _signed(recording, _ranged(recording, s, skip or 0, fit_range), skip or 0, solving)
    single = len(recording.starts) == 1
    head = initial_segment(recording, s, GRAM_SAMPLES) if single else recording
    found = _fitted(head, s, skip or 0, solving)
    longest = longest_transient(head) if skip is None else 0
    if longest:
        settled = _ranged(recording, s, longest, fit_range)
        later = _fitted(head, settled, longest, solving)
        spoiled = abs(s.y_scale / settled.y_scale) * found.fit.error
        if skip := transient(0.5 * spoiled, 0.5 * later.fit.error, longest):
            found = _fitted(head, _ranged(recording, s, skip, fit_range), skip, solving)
    if head.length < recording.length:
        counted = counted_from(recording, found.skip)
        found = replace(found, fit=_started(recording, counted, found.structure, found.fit.states, solving))
    return _narrowed(recording, found, solving) if fit_range else found


def _started(recording: Recording, counted: Mask, s: ModelStructure, states: States, solving: Solving) -> ForwardFit:
    """The forward fit that begins with the weights of (6)."""
    v = s.inverse_slope_map @ solving.optimum(accumulate(recording, counted, s, states, solving))
    return fit_forward(recording, counted, s, states, v, solving)


def _signed(recording: Recording, s: ModelStructure, skip: int, solving: Solving) -> ModelStructure:
    """The structure with the sign of the output that has the smaller cost (6)."""

    def cost(signed: ModelStructure) -> float:
        rest = [state_with_slopes(recording.x[part], signed, 0.0) for part in recording.parts]
        problem = accumulate(recording, counted_from(recording, skip), signed, rest, solving)
        return problem.cost(solving.optimum(problem))

    return min((s, s.reversed_output()), key=cost)


def _ranged(recording: Recording, s: ModelStructure, skip: int, fit_range: bool) -> ModelStructure:
    """The structure with the range of the counted outputs."""
    require(recording, counted_from(recording, skip), s, skip)
    if not fit_range:
        return s
    low, high = y_range(recording, skip)
    return replace(s, y_centre=0.5 * (low + high), y_scale=math.copysign(0.5 * (high - low), s.y_scale))


def _narrowed(recording: Recording, found: InitialFit, solving: Solving) -> InitialFit:
    """The same in the range of the modelled output: noise and ringing widen that of the measured one, so that the
    outermost pieces of S⁻¹ would hardly be visited."""
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
) -> InitialFit:
    """The forward fit from the best start of every part, or from given states of the first."""
    counted, parts = counted_from(recording, skip), recording.parts

    def fit(slope: float) -> ForwardFit:
        first, *later = (state_with_slopes(recording.x[part], s, slope) for part in parts)
        return _started(recording, counted, s, [state or first, *later], solving)

    def search(best: ForwardFit) -> ForwardFit:
        return fit_forward(recording, counted, s, best.states, best.v, solving, searched=[True])

    if len(parts) == 1:
        start, best = ("given", fit(0.0)) if state is not None else best_start(s.n, fit, search)
        return InitialFit(s, skip, [start], best)
    start, best = best_start(s.n, fit)
    starts, states = [start] * len(parts), list(best.states)
    for i, part in enumerate(parts):
        if counted[part].any():
            starts[i], own = start_of(recording.part(part), counted[part], s, best.v, solving)
            states[i] = own.states[0]
    if state is not None:
        starts[0], states[0] = "given", state
    searched = [start == SEARCHED for start in starts]
    best = fit_forward(recording, counted, s, states, best.v, solving, searched=searched)
    return InitialFit(s, skip, starts, best)


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
        s.n, lambda slope: fit([state_with_slopes(part.x, s, slope)]), lambda best: fit(best.states, [True])
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
    low, high = y_range(recording, skip)
    still = {"drive": skip and first_motion(recording, skip) == recording.length, "output": low == high}
    for what, rests in still.items():
        if rests:
            after = f" after the first {skip} samples, which are skipped" if skip else ""
            raise IdentificationError(f"{recording.name}: the {what} does not move{after}")


def initial_segment(recording: Recording, s: ModelStructure, size: int = HEAD) -> Recording:
    """The samples that decide about the start: those until every play that the drive moves is independent of its
    initial state, and some later ones."""
    span = recording.x_range[1] - recording.x_range[0]
    widths = (2.0 * r * s.x_scale for r in s.play_thresholds)
    return recording.head(index_after_travel(recording, max((w for w in widths if w < span), default=0.0)) + size)


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    y = recording.y[skip:]
    return float(y.min()), float(y.max())


def first_motion(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays at rest."""
    return index_after_travel(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def index_after_travel(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    x = recording.x[skip:]
    covered = np.flatnonzero(np.maximum.accumulate(x) - np.minimum.accumulate(x) >= span)
    return skip + int(covered[0]) if covered.size else recording.length


def longest_transient(recording: Recording) -> int:
    """Largest number of samples at the start that may be a transient; 0 if the drive does not move after them."""
    longest = int(TRANSIENT_SHARE * recording.parts[0].stop)
    return longest if longest and first_motion(recording, longest) < recording.length else 0


def transient(whole: Vector, later: Vector, longest: int) -> int:
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
