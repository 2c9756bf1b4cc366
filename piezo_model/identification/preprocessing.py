"""Preparation of an identification: the sign of the output, a switch-on transient and the initial state.

All samples of a recording are counted, since the initial state is estimated (`initial_state`), except first samples
that no initial state explains, as of an amplifier that was switched on: there the errors of the models of the whole and
of the rest are far larger than all later ones.
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
"""Smallest ratio of the later errors of fits with and without the first samples that shows these to be a transient."""


class Preprocessed(NamedTuple):
    """Structure with the sign and ranges of the counted samples, first counted sample, states before the first sample.

    ``rest`` is the input in unit amplitudes at which creep had rested, None if it rested with the plays.
    """

    structure: ModelStructure
    skip: int
    state: OperatorState
    rest: float | None


def preprocess(
    recording: Recording, s: ModelStructure, solver: str, proximal: float, skip: int | None, fit_range: bool
) -> Preprocessed:
    """Find the sign of the output, the samples to skip, and the states before the first sample.

    By default the samples of a transient are skipped; with ``fit_range`` the output's range in the structure becomes
    that of the counted samples. IdentificationError if too few samples are left.
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

    def initial(s: ModelStructure, skip: int, refine: bool = True) -> tuple[OperatorState, float | None]:
        return find_initial_state(head, s, lambda state: cost(s, skip, state), refine)

    def errors(s: ModelStructure, skip: int, state: OperatorState) -> Vector:
        x, y = head.x, head.counted_y
        model = HysteresisCreepModel.from_weights(s, fitted(s, skip, state)[1])
        return np.abs(np.nan_to_num(model.simulate(x, state) - y)) / (2.0 * abs(s.y_scale))

    def transient(longest: int) -> int:
        """Number of first samples that the model of the rest does not describe; 0 if the model of the whole describes
        them and all others."""
        state, settled = initial(s, 0, refine=False)[0], ranged(s, longest)
        whole = errors(s, 0, state)
        if not transient_end(whole, longest):
            rest = errors(settled, longest, state)
            ratio = abs(s.y_scale / settled.y_scale)  # the two errors are shares of different ranges
            if ratio * float(np.max(whole[longest:])) <= SPOILED * float(np.max(rest[longest:])):
                return 0
        return transient_end(errors(settled, longest, initial(settled, longest)[0]), longest)

    s = ranged(s, skip or 0)
    rest = OperatorState.settled_at(s, float(head.x[0]))
    s = min((s, s.reversed_output()), key=lambda signed: cost(signed, skip or 0, rest))
    if skip is None:
        longest = longest_transient(head, s)
        skip = transient(longest) if longest else 0
        s = ranged(s, skip)
    return Preprocessed(s, skip, *initial(s, skip))


def require(recording: Recording, s: ModelStructure, skip: int) -> None:
    """Refuse a recording with too few samples, or no movement, after the skipped ones."""
    if recording.length - skip <= s.d:
        raise IdentificationError(
            f"{recording.name}: only {max(recording.length - skip, 0)} of {recording.length} samples are counted"
            f"{f' after skipping {skip}' if skip else ''}, too few for {s.d} weights"
        )
    if skip and moving_from(recording, skip) == recording.length:
        raise IdentificationError(
            f"{recording.name}: the drive does not move after the first {skip} samples, which are skipped"
        )
