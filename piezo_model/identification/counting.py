"""What an identification counts, and from which states on: the sign of the output, a switch-on transient, the start.

A recording is counted from its first sample, since the start is found (`start`). Left out is only what no start explains: first
samples at which the model of the whole, and that of the rest, errs far more than anywhere later, as where an amplifier was switched on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from piezo_model.identification.fitting import IdentificationError, accumulate, optimum
from piezo_model.identification.start import find_start
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

HEAD, LONGEST_HEAD = 200_000, 500_000
"""Samples that the start is found from: the first, or twice as many as it takes for the plays to forget it."""
TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
MOVED = 0.01
"""Share of its range that a drive covers within the noise of its rest."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""An error at the start is a transient's beyond so many times the largest later one, and beyond this share of the range."""
SPOILED = 3.0
"""First samples spoil a fit that errs so many times as much after them as the fit without them."""


@dataclass(frozen=True)
class Counted:
    """Structure with the sign and ranges of the counted part, first counted sample, states before the first sample.

    ``rest`` is the input in unit amplitudes at which creep had rested, None where it rested with the plays.
    """

    structure: ModelStructure
    skip: int
    state: OperatorState
    rest: float | None


def head_of(recording: Recording, s: ModelStructure) -> Recording:
    """The samples that starts are tried on."""
    settled = settled_from(recording, s)
    return recording.head(max(HEAD, min(2 * settled, max(LONGEST_HEAD, settled + HEAD // 2))))


def settled_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves at all is known, whatever it started at."""
    span = recording.x_range[1] - recording.x_range[0]
    return covered_from(recording, max((2.0 * r * s.x_scale for r in s.play_thresholds if 2.0 * r * s.x_scale < span), default=0.0))


def moving_from(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if it stays so."""
    return covered_from(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def covered_from(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it never does."""
    low, high, seen = math.inf, -math.inf, 0
    for x, _ in recording.chunks():
        after = max(skip - seen, 0)
        lows, highs = np.minimum.accumulate(np.minimum(x[after:], low)), np.maximum.accumulate(np.maximum(x[after:], high))
        covered = np.flatnonzero(highs - lows >= span)
        if covered.size:
            return seen + after + int(covered[0])
        low, high, seen = np.min(lows, initial=low), np.max(highs, initial=high), seen + x.size
    return seen


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    if skip == 0:
        return recording.y_range
    low, high, seen = math.inf, -math.inf, 0
    for _, y in recording.chunks():
        counted = y[max(skip - seen, 0):]
        low, high = float(np.min(counted, initial=low)), float(np.max(counted, initial=high))
        seen += y.size
    return low, high


def count(recording: Recording, s: ModelStructure, solver: str, proximal: float, skip: int | None, fit_range: bool) -> Counted:
    """Find the sign of the output, what to leave out at the start, and the states before the first sample.

    First samples to ``skip`` are a transient's by default; with ``fit_range`` the output's range in the structure becomes that of the counted
    part. IdentificationError where too few samples are left.
    """
    head = head_of(recording, s)

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
        return find_start(head, s, lambda state: cost(s, skip, state), refine)

    def errors(s: ModelStructure, skip: int, state: OperatorState) -> Vector:
        x, y = head.arrays()
        model = HysteresisCreepModel.from_weights(s, fitted(s, skip, state)[1])
        return np.abs(model.simulate(x, state.copy()) - y) / (2.0 * abs(s.y_scale))

    def transient(look: int) -> int:
        """First samples that the model of the whole does not describe, or is spoiled by, and that of the rest does not describe either."""
        state, settled = found(s, 0, refine=False)[0], ranged(s, look)
        whole = errors(s, 0, state)
        if not _stands_out(whole, look):
            rest = errors(settled, look, state)
            ratio = abs(s.y_scale / settled.y_scale)  # of the ranges that both are shares of
            if ratio * float(np.max(whole[look:])) <= SPOILED * float(np.max(rest[look:])):
                return 0
        rest = errors(settled, look, found(settled, look)[0])
        return int(np.flatnonzero(rest[:look] > np.max(rest[look:]))[-1]) + 1 if _stands_out(rest, look) else 0

    s = ranged(s, skip or 0)
    rest = OperatorState.at_rest(s, float(s.unit_input(next(head.chunks(1))[0])[0]))
    s = min((s, s.turned()), key=lambda each: cost(each, skip or 0, rest))
    if skip is None:
        look = min(settled_from(head, s), int(TRANSIENT_SHARE * head.length))
        look = look if moving_from(head, look) < head.length else 0
        skip = transient(look) if look else 0
        s = ranged(s, skip)
    return Counted(s, skip, *found(s, skip))


def require(recording: Recording, s: ModelStructure, skip: int) -> None:
    """Refuse a recording that skipping leaves too little of, or no movement."""
    if recording.length - skip <= s.d:
        raise IdentificationError(f"{recording.name}: only {max(recording.length - skip, 0)} of {recording.length} samples "
                                  f"are left after skipping {skip}, too few for {s.d} weights")
    if skip and moving_from(recording, skip) == recording.length:
        raise IdentificationError(f"{recording.name}: the drive does not move after the first {skip} samples, which are skipped")


def _stands_out(error: Vector, look: int) -> bool:
    """Whether an error, as a share of the range, is far larger before the sample ``look`` than anywhere after it."""
    return bool(np.max(error[:look]) > max(FAR_MORE * float(np.max(error[look:])), NOTABLE))
