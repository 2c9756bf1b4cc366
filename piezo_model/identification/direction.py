"""Which of two signals drove the other, where the names of the columns do not say it: the one from which a model
explains the other better.

The guess by values (`piezo_model.recordings.profile`) looks at the sense of the loops alone, which an open path or a
drift turns. A model is fitted both ways round: the operators only ever lag, so that the drive explains the output and
not the other way round.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from piezo_model.identification.fit_report import percent
from piezo_model.model import HysteresisCreepModel
from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.profile import REASONS

SAMPLES = 20_000
"""That both ways are tried on, from the start."""
CLEAR = 1.25
"""The larger error is so many times the smaller one where the fit contradicts a guess."""


def directed(recording: Recording, fit: Callable[[Recording], HysteresisCreepModel]) -> Recording:
    """The recording, or with input and output exchanged where they were guessed by their values and the fit contradicts
    that.

    Raises
    ------
    RecordingError
        Input and output were guessed, and the recording does not tell which is which.
    """
    if recording.reasons.get("input") not in REASONS or recording.reasons.get("output") not in REASONS:
        return recording
    part = recording.head(SAMPLES)
    reports = [fit(each).report for each in (part, part.swapped())]
    errors = [float(report["fit"]["rms_percent"]) for report in reports]
    either = f"{percent(errors[0])} of the range as they were guessed and {percent(errors[1])} the other way round"
    if any(report["one_way"] for report in reports) or errors[1] < errors[0] <= CLEAR * errors[1]:
        raise RecordingError(
            f"{recording.name}: cannot tell which column is the input and which the output: a model "
            f"leaves {either}; name them "
            f"with --input and --output"
        )
    found = recording if errors[0] <= errors[1] else recording.swapped()
    reason = (
        f"because a model leaves {percent(min(errors))} of the range that way and {percent(max(errors))} the "
        "other way round"
    )
    return replace(
        found, reasons={role: reason if role in ("input", "output") else why for role, why in found.reasons.items()}
    )
