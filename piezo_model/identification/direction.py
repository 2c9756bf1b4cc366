"""Which of two guessed columns is the input: a model is fitted in both directions.

The guess (`piezo_model.recordings.evidence`) depends on the sense of the loops alone, which an open path or a drift
reverses. The operators can only lag, so the drive explains the output and not vice versa.
"""

import math
from dataclasses import replace

from piezo_model.identification.adequacy import is_one_way
from piezo_model.identification.error_model import Solving, one_thread
from piezo_model.identification.report import percent
from piezo_model.identification.start import USUAL, prepare, structure_of
from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.evidence import REASONS

SAMPLES = 20_000
"""Samples from the start to which both directions are fitted."""
CLEAR = 1.15
"""Smallest ratio of the two errors that contradicts a guess."""


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
    part = recording.head(SAMPLES)
    ways = [part, part.swapped()]
    fits = [prepare(way, structure_of(way, *USUAL), Solving(), fit_range=True) for way in ways]
    errors = [50.0 * math.sqrt(prepared.fit.cost) for prepared in fits]
    either = f"{percent(errors[0])} of the range as they were guessed and {percent(errors[1])} the other way round"
    if any(is_one_way(way.x) for way in ways) or errors[1] < errors[0] <= CLEAR * errors[1]:
        raise RecordingError(
            f"{recording.name}: cannot tell which column is the input and which the output: a model "
            f"leaves {either}; name them with --input and --output"
        )
    reason = (
        f"because a model leaves {percent(min(errors))} of the range that way and {percent(max(errors))} the "
        "other way round"
    )
    reasons = {role: reason if role in ("input", "output") else why for role, why in recording.reasons.items()}
    return replace(recording if errors[0] <= errors[1] else recording.swapped(), reasons=reasons)
