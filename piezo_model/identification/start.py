"""The sign of the output, a switch-on transient, and the states before the first sample, which no recording contains.

The initial states of a part are a memory curve. The state of a play is visible until the drive erases it, so nearly
every sample contributes. Four curves are compared by the output errors of their forward fits (`forward`): at rest,
dz/dr = 0; after a long ascent, −1; after a long descent, 1; and searched, with the slopes as further unknowns, starting
from the best of these. Another curve replaces rest only for a significant gain, since more unknowns always fit a
little better. Creep rests with the plays. The samples of a transient are skipped: first samples that no start explains,
with errors far larger than all later ones.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    ProgramSolver,
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
"""Number of unknowns to which the choice among three curves is equivalent."""
HEAD = 200_000
"""Samples, after the drive has erased the initial states, that decide on the start."""
NARROWER, FLAT, MOVED = 0.005, 0.1, 0.01
"""Smallest narrowing of the output's range that is applied; smallest range that remains; largest movement of a drive at
rest; all relative to the whole ranges."""
USUAL = 5, 3
"""Orders n and m of a first fit."""
TRANSIENT_SHARE, FAR_MORE, NOTABLE, LARGER, SPOILED = 0.1, 4.0, 0.03, 1.5, 3.0
"""Of a transient: greatest length relative to the recording; smallest ratio of its error to the largest later error;
smallest error relative to the range; smallest ratio of errors at its end; and smallest ratio of the later errors of
fits with and without the first samples that identifies these as a transient."""


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
    """The first fit, from which the orders are chosen."""

    skip: int
    starts: Sequence[str]
    """A key of CURVES, "searched" or "given" for each part."""
    fit: ForwardFit
    """Its structure has the sign of the output, and the range of the modelled output."""


def prepare(
    recording: Recording,
    s: ModelStructure,
    qp_solver: ProgramSolver,
    skip: int | None = None,
    state: OperatorState | None = None,
    *,
    fit_range: bool = False,
) -> InitialFit:
    """Find the sign of the output, the samples to skip, and the states before the first sample of each part.

    By default the samples of a transient are skipped. With ``fit_range`` the output range of the structure becomes that
    of the counted samples. IdentificationError if too few samples are left.
    """
    if state is not None:
        refuse_too_little_data(recording, counted_from(recording, skip or 0), s, skip or 0)
        return _fit_from_best_starts(recording, s, skip or 0, qp_solver, state)
    s = _with_sign(recording, _with_output_range(recording, s, skip or 0, fit_range), skip or 0, qp_solver)
    head = initial_segment(recording, s, GRAM_SAMPLES) if len(recording.starts) == 1 else recording
    initial = _fit_from_best_starts(head, s, skip or 0, qp_solver)
    longest = longest_transient(head) if skip is None else 0
    if longest:
        settled = _with_output_range(recording, s, longest, fit_range)
        later = _fit_from_best_starts(head, settled, longest, qp_solver)
        spoiled = abs(s.y_scale / settled.y_scale) * initial.fit.error
        if skip := transient(0.5 * spoiled, 0.5 * later.fit.error, longest):
            initial = _fit_from_best_starts(head, _with_output_range(recording, s, skip, fit_range), skip, qp_solver)
    if head.length < recording.length:
        counted, s, states = counted_from(recording, initial.skip), initial.fit.structure, initial.fit.states
        initial = replace(initial, fit=_fit_from_program(recording, counted, s, states, qp_solver))
    return _with_modelled_range(initial, qp_solver) if fit_range else initial


def _fit_from_program(
    recording: Recording, counted: Mask, s: ModelStructure, states: States, qp_solver: ProgramSolver
) -> ForwardFit:
    """The forward fit from the weights of (6)."""
    v = s.inverse_slope_map @ qp_solver.optimum(accumulate(recording, counted, s, states, qp_solver))
    return fit_forward(recording, counted, s, states, v, qp_solver)


def _with_sign(recording: Recording, s: ModelStructure, skip: int, qp_solver: ProgramSolver) -> ModelStructure:
    """The structure with the sign of the output that has the smaller cost (6)."""

    def cost(signed: ModelStructure) -> float:
        rest = [state_with_slopes(recording.x[part], signed, 0.0) for part in recording.parts]
        problem = accumulate(recording, counted_from(recording, skip), signed, rest, qp_solver)
        return problem.cost(qp_solver.optimum(problem))

    return min((s, s.reversed_output()), key=cost)


def _with_output_range(recording: Recording, s: ModelStructure, skip: int, fit_range: bool) -> ModelStructure:
    """The structure with the range of the counted outputs, if that is to be fitted."""
    refuse_too_little_data(recording, counted_from(recording, skip), s, skip)
    if not fit_range:
        return s
    low, high = y_range(recording, skip)
    return replace(s, y_centre=0.5 * (low + high), y_scale=math.copysign(0.5 * (high - low), s.y_scale))


def _with_modelled_range(initial: InitialFit, qp_solver: ProgramSolver) -> InitialFit:
    """The fit with the range of the modelled output. Noise and ringing widen the range of the measured output, so that
    the outermost pieces of S⁻¹ would hardly be visited."""
    fit, s, recording, counted = initial.fit, initial.fit.structure, initial.fit.recording, initial.fit.counted
    low, high = float(fit.y_model[counted].min()), float(fit.y_model[counted].max())
    if high - low < 2.0 * FLAT or max(1.0 - high, low + 1.0) < NARROWER:
        return initial
    s = replace(s, y_centre=s.y_centre + 0.5 * (low + high) * s.y_scale, y_scale=0.5 * (high - low) * s.y_scale)
    modelled = replace(recording, y=fit.structure.y_centre + fit.structure.y_scale * fit.y_model)
    v = s.inverse_slope_map @ qp_solver.optimum(accumulate(modelled, counted, s, fit.states, qp_solver))
    return replace(initial, fit=fit_forward(recording, counted, s, fit.states, v, qp_solver))


def _fit_from_best_starts(
    recording: Recording, s: ModelStructure, skip: int, qp_solver: ProgramSolver, state: OperatorState | None = None
) -> InitialFit:
    """The forward fit from the best start of every part, or from known states of the first part."""
    counted, parts = counted_from(recording, skip), recording.parts

    def fit(slope: float) -> ForwardFit:
        first, *later = (state_with_slopes(recording.x[part], s, slope) for part in parts)
        return _fit_from_program(recording, counted, s, [state or first, *later], qp_solver)

    if len(parts) == 1:
        start, best = (
            ("given", fit(0.0))
            if state is not None
            else best_start(
                s.n,
                fit,
                lambda best: fit_forward(recording, counted, s, best.states, best.v, qp_solver, searched=[True]),
            )
        )
        return InitialFit(skip, [start], best)
    start, best = best_start(s.n, fit)
    starts, states = [start] * len(parts), list(best.states)
    for i, part in enumerate(parts):
        if counted[part].any():
            starts[i], own = start_of(recording.part(part), counted[part], s, best.v, qp_solver)
            states[i] = own.states[0]
    if state is not None:
        starts[0], states[0] = "given", state
    best = fit_forward(
        recording, counted, s, states, best.v, qp_solver, searched=[start == SEARCHED for start in starts]
    )
    return InitialFit(skip, starts, best)


def start_of(
    part: Recording,
    counted: Mask,
    s: ModelStructure,
    v: Vector,
    qp_solver: ProgramSolver,
    further: Columns | None = None,
    parameters: Parameters | None = None,
) -> tuple[str, ForwardFit]:
    """The best start of one part for known weights and dynamics, and its fit."""

    def fit(states: States, searched: Sequence[bool] = ()) -> ForwardFit:
        return fit_forward(
            part,
            counted,
            s,
            states,
            v,
            qp_solver,
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
    """The start with the smallest output error, and its fit; a simpler one unless the gain is significant."""
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


def refuse_too_little_data(recording: Recording, counted: Mask, s: ModelStructure, skip: int) -> None:
    """Refuse a recording with too few samples, or without movement, after the skipped samples."""
    count = int(np.count_nonzero(counted))
    if count <= s.d:
        samples = f"{count} samples" if count == recording.length else f"only {count} of {recording.length} samples"
        raise IdentificationError(
            f"{recording.name}: {samples} are counted{f' after skipping {skip}' if skip else ''}, too few for "
            f"{s.d} weights"
        )
    low, high = y_range(recording, skip)
    drive_rests = skip and first_motion(recording, skip) == recording.length
    if drive_rests or low == high:
        after = f" after the first {skip} samples, which are skipped" if skip else ""
        raise IdentificationError(f"{recording.name}: the {'drive' if drive_rests else 'output'} does not move{after}")


def initial_segment(recording: Recording, s: ModelStructure, size: int = HEAD) -> Recording:
    """The samples that decide on the start: those until every play that the drive moves has lost its initial state, and
    ``size`` later ones."""
    span = recording.x_range[1] - recording.x_range[0]
    widths = (2.0 * r * s.x_scale for r in s.play_thresholds)
    return recording.head(index_after_travel(recording, max((w for w in widths if w < span), default=0.0)) + size)


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output without the first ``skip`` samples."""
    y = recording.y[skip:]
    return float(y.min()), float(y.max())


def first_motion(recording: Recording, skip: int) -> int:
    """Index of the first sample from ``skip`` at which the drive has left its rest; the length of the recording if it
    never does."""
    return index_after_travel(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def index_after_travel(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does so."""
    x = recording.x[skip:]
    covered = np.flatnonzero(np.maximum.accumulate(x) - np.minimum.accumulate(x) >= span)
    return skip + int(covered[0]) if covered.size else recording.length


def longest_transient(recording: Recording) -> int:
    """Largest number of samples at the start that may be a transient; 0 if the drive does not move after them."""
    longest = int(TRANSIENT_SHARE * recording.parts[0].stop)
    return longest if longest and first_motion(recording, longest) < recording.length else 0


def transient(whole: Vector, later: Vector, longest: int) -> int:
    """Number of first samples that a fit of the later ones does not describe; 0 if the fit of all samples describes
    them. The errors (N,) of both fits are relative to the same range."""
    whole, later = np.abs(whole), np.abs(later)
    spoiled = float(np.max(whole[longest:])) > SPOILED * float(np.max(later[longest:]))
    return transient_end(later, longest) if spoiled or transient_end(whole, longest) else 0


def transient_end(error: Vector, longest: int) -> int:
    """Number of samples in a transient of at most ``longest``, whose errors (relative to the range) are far larger than
    all later ones; 0 without a transient."""
    later = float(np.max(error[longest:]))
    if np.max(error[:longest], initial=0.0) <= max(FAR_MORE * later, NOTABLE):
        return 0
    return int(np.flatnonzero(error[:longest] > LARGER * later)[-1]) + 1
