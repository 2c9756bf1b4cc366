"""What would make a refused recording give a model: options are tried before one is suggested."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from piezo_model.identification.fit_report import percent
from piezo_model.identification.fitting import IdentificationError
from piezo_model.model import HysteresisCreepModel
from piezo_model.recordings import Recording

LONGEST_TRANSIENT = 0.1
"""Share of the recording within which a transient is looked for."""

Refit = Callable[..., HysteresisCreepModel]
"""The identification again with other keywords; IdentificationError where it is refused again."""


def remedy(refit: Refit, recording: Recording, skip: int | None, m: int | None) -> str:
    """A clause that names the option with which the recording does give a model, with the error then; "" where none was
    found.

    What is tried: to leave out first samples, and lower orders than ``m``, None where it may not be chosen.
    """
    if (found := _transient(refit, recording, skip or 0)) is not None:
        return (
            f"; its first {found[0]} samples seem to hold a transient: with --skip {found[0]} the model leaves "
            f"{found[1]}"
        )
    for lower in range((m or 0) - 1, -1, -1):
        if (model := _tried(refit, m=lower)) is not None:
            return f"; with --m {lower} the model leaves {_left(model)}"
    return ""


def _transient(refit: Refit, recording: Recording, skip: int) -> tuple[int, str] | None:
    """Fewest first samples without which there is a model, and what that leaves."""
    longest = int(LONGEST_TRANSIENT * recording.length)
    model = _tried(refit, skip=longest) if longest > skip else None
    if model is None or model.start is None:
        return None
    x, y = recording.head(2 * longest).arrays()
    error = np.abs(model.simulate(x, model.start.copy()) - y)
    beyond = np.flatnonzero(error[:longest] > model.report["fit"]["max"])
    fewest = int(beyond[-1]) + 1 if beyond.size else 0
    if fewest > skip and (again := _tried(refit, skip=fewest)) is not None:
        return fewest, _left(again)
    return longest, _left(model)


def _tried(refit: Refit, **changes: int) -> HysteresisCreepModel | None:
    try:
        return refit(**changes)
    except IdentificationError:
        return None


def _left(model: HysteresisCreepModel) -> str:
    return percent(float(model.report["fit"]["rms_percent"]))
