"""Which of two guessed columns is the input: a model is fitted in both directions.

The guess (`piezo_model.recordings.evidence`) depends on the sense of the loops alone, which an open path or a drift
reverses. The operators can only lag, so the drive explains the output and not vice versa.
"""

import math
from dataclasses import replace

import numpy as np

from piezo_model.identification.error_model import Solving, one_thread
from piezo_model.identification.forward import EXACT
from piezo_model.identification.start import USUAL, first_motion, prepare, structure_of, y_range
from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.evidence import REASONS, TOO_FEW, level_count
from piezo_model.structure import SMALLEST
from piezo_model.units import percent
from solvers.arrays import Vector

SAMPLES = 20_000
"""Samples from the first motion to which both directions are fitted."""
CLEAR = 1.15
"""Smallest ratio of the two errors that contradicts a guess."""
STATED = 2.0
"""The same for what a user or a header states."""
ONE_WAY = 0.9
"""Smallest share of the drive's travel in one direction that counts as a single branch."""


def is_monotonic(x: Vector) -> bool:
    """Whether a drive (N,) is nearly a single branch."""
    travel = np.diff(x)
    up, down = float(travel[travel > 0].sum()), -float(travel[travel < 0].sum())
    return max(up, down) > ONE_WAY * max(up + down, 1e-300)


def errors_both_ways(part: Recording) -> list[float]:
    """RMS errors of a model from input to output and of one from output to input, per cent of the range of each."""
    errors = []
    for way in (part, part.swapped()):
        prepared = prepare(way, structure_of(way, *USUAL), Solving(), fit_range=True)
        low, high = y_range(way, prepared.skip)
        rms = abs(prepared.structure.y_scale) * math.sqrt(max(prepared.fit.cost, EXACT))
        errors.append(100.0 * rms / max(high - low, SMALLEST))
    return errors


def swapped(recording: Recording, skip: int, error_percent: float) -> str | None:
    """A clause that input and output of a recording, whose model has this error, seem to be swapped; None if they do
    not."""
    if recording.uncounted.any() or 0 < level_count(recording.x) <= TOO_FEW:  # few levels have no loops
        return None
    own, other = errors_both_ways(recording.head(first_motion(recording, skip) + SAMPLES))
    if min(own, error_percent) < STATED * other:
        return None
    return f"input and output seem to be swapped, since a model the other way round errs by {percent(other)} RMS"


@one_thread
def check_direction(recording: Recording) -> Recording:
    """The recording, with input and output swapped if they were guessed by their values and a fit contradicts that.

    Raises
    ------
    RecordingError
        Input and output were guessed, and the fits do not distinguish them.
    """
    if recording.uncounted.any() or not {recording.reasons.get(role) for role in ("input", "output")} <= {*REASONS}:
        return recording
    part = recording.head(first_motion(recording, 0) + SAMPLES)
    errors = errors_both_ways(part)
    either = f"{percent(errors[0])} of range as they were guessed and {percent(errors[1])} the other way round"
    if is_monotonic(part.x) or is_monotonic(part.y) or errors[1] < errors[0] <= CLEAR * errors[1]:
        raise RecordingError(
            f"{recording.name}: cannot tell which column is the input and which the output: the RMS "
            f"residual of a model is {either}; name them with --input and --output"
        )
    reason = (
        f"because the RMS residual of a model is {percent(min(errors))} of range that way and "
        f"{percent(max(errors))} the other way round"
    )
    reasons = {role: reason if role in ("input", "output") else why for role, why in recording.reasons.items()}
    return replace(recording if errors[0] <= errors[1] else recording.swapped(), reasons=reasons)
