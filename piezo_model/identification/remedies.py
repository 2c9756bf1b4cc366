"""Options with which a refused recording gives a model; each is tried before it is suggested."""

from collections.abc import Callable

import numpy as np

from piezo_model.identification.fit_report import percent
from piezo_model.identification.fitting import IdentificationError
from piezo_model.identification.initial_state import TRANSIENT_SHARE, transient_end
from piezo_model.model import HysteresisCreepModel
from piezo_model.recordings import Recording

Refit = Callable[..., HysteresisCreepModel]
"""Repeats the identification with other options; IdentificationError if it is refused again."""


def remedy(refit: Refit, recording: Recording, skip: int, m: int, explained: float) -> str:
    """A clause that names the option with which the recording gives a model, and its error; "" without one.

    More skipped samples are tried, and orders lower than ``m``, which is 0 if it is fixed. A model must have a smaller
    error than the explanation of the refusal, ``explained`` as a share of the range.
    """

    def tried(**changes: int) -> HysteresisCreepModel | None:
        try:
            model = refit(**changes)
        except IdentificationError:
            return None
        return model if model.report["fit"]["rms_percent"] < 100.0 * explained else None

    if (model := _without_transient(tried, recording, skip)) is not None:
        first = int(model.report["fit"]["skipped"])
        return f"; its first {first} samples seem to hold a transient: with --skip {first} {_error(model)}"
    for lower in range(m - 1, -1, -1):
        if (model := tried(m=lower)) is not None:
            return f"; with --m {lower} {_error(model)}"
    return ""


def _without_transient(
    tried: Callable[..., HysteresisCreepModel | None], recording: Recording, skip: int
) -> HysteresisCreepModel | None:
    """The model without a transient; None if the errors of the first samples are not far larger than all others within
    the same range of the drive."""
    longest = int(TRANSIENT_SHARE * recording.length)
    model = tried(skip=longest) if longest > skip else None
    if model is None or model.start is None:
        return None
    head = recording.head(2 * longest)
    x, y = head.x, head.counted_y
    known = (x >= x[longest:].min()) & (x <= x[longest:].max())
    error = np.where(known, np.abs(np.nan_to_num(model.simulate(x) - y)), 0.0) / model.report["fit"]["span"]
    fewest = transient_end(error, longest)
    if not fewest:
        return None
    return (tried(skip=fewest) if fewest > skip else None) or model


def _error(model: HysteresisCreepModel) -> str:
    return f"the model leaves {percent(float(model.report['fit']['rms_percent']))}"
