"""What an identification counts, and from which states on: the sign of the output, a switch-on transient, the start.

A recording is counted from its first sample, since the start is found (`initial_state`). Left out is only what no start
explains: first samples at which the model of the whole, and that of the rest, errs far more than anywhere later, as
where an amplifier was switched on.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from piezo_model.identification.fitting import IdentificationError, accumulate, optimum
from piezo_model.identification.initial_state import (
    find_initial_state,
    head_of,
    longest_transient,
    moving_from,
    transient_end,
    y_range,
)
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

SPOILED = 3.0
"""First samples spoil a fit that errs so many times as much after them as the fit without them."""


class Preprocessed(NamedTuple):
    """Structure with the sign and ranges of the counted part, first counted sample, states before the first sample.

    ``rest`` is the input in unit amplitudes at which creep had rested, None where it rested with the plays.
    """

    structure: ModelStructure
    skip: int
    state: OperatorState
    rest: float | None


def preprocess(
    recording: Recording, s: ModelStructure, solver: str, proximal: float, skip: int | None, fit_range: bool
) -> Preprocessed:
    """Find the sign of the output, what to leave out at the start, and the states before the first sample.

    First samples to ``skip`` are a transient's by default; with ``fit_range`` the output's range in the structure
    becomes that of the counted part. IdentificationError where too few samples are left.
    """
    head = head_of(recording, s, skip or 0)

    def fitted(s: ModelStructure, skip: int, state: OperatorState) -> tuple[IdentificationProblem, Vector]:
        problem = accumulate(head, s, skip, state, proximal)
        return problem, optimum(problem, solver)

    def cost(s: ModelStructure, skip: int, state: OperatorState) -> float:
        problem, w = fitted(s, skip, state)
        return 2.0 * problem.cost(w)

    def ranged(s: ModelStructure, skip: int) -> ModelStructure:
        require(recording, s, skip)
        low, high = y_range(recording, skip)
        if not fit_range or low == high:
            return s
        return replace(s, y_centre=0.5 * (low + high), y_scale=math.copysign(0.5 * (high - low), s.y_scale))

    def found(s: ModelStructure, skip: int, refine: bool = True) -> tuple[OperatorState, float | None]:
        return find_initial_state(head, s, lambda state: cost(s, skip, state), refine)

    def errors(s: ModelStructure, skip: int, state: OperatorState) -> Vector:
        x, y = head.arrays()
        model = HysteresisCreepModel.from_weights(s, fitted(s, skip, state)[1])
        return np.abs(model.simulate(x, state.copy()) - y) / (2.0 * abs(s.y_scale))

    def transient(look: int) -> int:
        """First samples that the model of the whole does not describe, or is spoiled by, and that of the rest does not
        describe either."""
        state, settled = found(s, 0, refine=False)[0], ranged(s, look)
        whole = errors(s, 0, state)
        if not transient_end(whole, look):
            rest = errors(settled, look, state)
            ratio = abs(s.y_scale / settled.y_scale)  # of the ranges that both are shares of
            if ratio * float(np.max(whole[look:])) <= SPOILED * float(np.max(rest[look:])):
                return 0
        return transient_end(errors(settled, look, found(settled, look)[0]), look)

    s = ranged(s, skip or 0)
    rest = OperatorState.at_rest(s, float(s.unit_input(next(head.chunks(1))[0])[0]))
    s = min((s, s.turned()), key=lambda each: cost(each, skip or 0, rest))
    if skip is None:
        look = longest_transient(head, s)
        skip = transient(look) if look else 0
        s = ranged(s, skip)
    return Preprocessed(s, skip, *found(s, skip))


def require(recording: Recording, s: ModelStructure, skip: int) -> None:
    """Refuse a recording that skipping leaves too little of, or no movement."""
    if recording.length - skip <= s.d:
        raise IdentificationError(
            f"{recording.name}: only {max(recording.length - skip, 0)} of {recording.length} samples are counted"
            f"{f' after skipping {skip}' if skip else ''}, too few for {s.d} weights"
        )
    if skip and moving_from(recording, skip) == recording.length:
        raise IdentificationError(
            f"{recording.name}: the drive does not move after the first {skip} samples, which are skipped"
        )
