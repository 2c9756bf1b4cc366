"""What would make a refused recording give a model: options are tried before one is suggested."""

from collections.abc import Callable

import numpy as np

from piezo_model.identification.fit_report import percent
from piezo_model.identification.fitting import IdentificationError
from piezo_model.identification.initial_state import TRANSIENT_SHARE, transient_end
from piezo_model.model import HysteresisCreepModel
from piezo_model.recordings import Recording

Refit = Callable[..., HysteresisCreepModel]
"""The identification again with other keywords; IdentificationError where it is refused again."""


def remedy(refit: Refit, recording: Recording, skip: int, m: int, explained: float) -> str:
    """A clause that names the option with which the recording does give a model, with the error then; "" where none was
    found.

    What is tried: to leave out first samples, and lower orders than ``m``, 0 where it may not be chosen. An option
    that leaves more than the explanation of the refusal does, ``explained`` as a share of the range, helps nobody.
    """

    def tried(**changes: int) -> HysteresisCreepModel | None:
        try:
            model = refit(**changes)
        except IdentificationError:
            return None
        return model if model.report["fit"]["rms_percent"] < 100.0 * explained else None

    if (found := _transient(tried, recording, skip)) is not None:
        first = int(found.report["fit"]["skipped"])
        return (
            f"; its first {first} samples seem to hold a transient: with --skip {first} the model leaves {_left(found)}"
        )
    for lower in range(m - 1, -1, -1):
        if (model := tried(m=lower)) is not None:
            return f"; with --m {lower} the model leaves {_left(model)}"
    return ""


def _transient(
    tried: Callable[..., HysteresisCreepModel | None], recording: Recording, skip: int
) -> HysteresisCreepModel | None:
    """The model without the fewest first samples that it takes, where it errs far more in them than in all others,
    and not because the drive goes farther there."""
    longest = int(TRANSIENT_SHARE * recording.length)
    model = tried(skip=longest) if longest > skip else None
    if model is None or model.start is None:
        return None
    x, y = recording.head(2 * longest).arrays()
    known = (x >= x[longest:].min()) & (x <= x[longest:].max())
    error = np.where(known, np.abs(model.simulate(x, model.start.copy()) - y), 0.0) / model.report["fit"]["span"]
    fewest = transient_end(error, longest)
    if not fewest:
        return None
    return (tried(skip=fewest) if fewest > skip else None) or model


def _left(model: HysteresisCreepModel) -> str:
    return percent(float(model.report["fit"]["rms_percent"]))
