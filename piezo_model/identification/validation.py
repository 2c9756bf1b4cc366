"""A model on a recording that its identification has not seen.

The weights stay. What no recording holds is found as in the identification: the states before the first sample (`start`), here by
the variance of the output's error, and the sensor's offset between the two sessions, which is the mean of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from piezo_model.identification.counting import head_of
from piezo_model.identification.fit_report import Fit, percent
from piezo_model.identification.fitting import IdentificationError
from piezo_model.identification.forward_error import forward_error
from piezo_model.identification.lag_identification import without_lag
from piezo_model.identification.start import find_start
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.units import quantity

SAME = 1.001
"""Share of the reported error up to which the start that the identification found explains a recording."""


@dataclass(frozen=True)
class Validation:
    """What a model is worth on a recording."""

    fit: Fit
    """The figures that an identification reports, with ``shift`` removed."""
    shift: float
    """Offset of the sensor against the session of the identification, output unit."""
    start: OperatorState
    """States before the first sample, as they were found."""
    fitted_rms_percent: float | None
    """What the identification reported."""
    beyond_percent: float
    """How far the drive leaves the range that the model was identified over, per cent of that range."""
    unit: str
    """Of the output."""
    warning: str
    """What speaks against the model where it was forced."""

    def to_dict(self) -> dict[str, Any]:
        """Figures and sentences as JSON can hold them."""
        return {"fit": asdict(self.fit), "shift": self.shift, "sentences": list(self.sentences())}

    def sentences(self) -> Iterator[str]:
        """The headline, then what an engineer has to know."""
        if self.warning:
            yield self.warning
        yield self.fit.headline(self.unit, "on this recording")
        if abs(self.shift) > 0.1 * self.fit.rms:
            yield (f"The sensor stands {quantity(self.shift, self.unit, 3)} ({percent(100.0 * self.shift / self.fit.span)} of the "
                   f"range) from where it stood in the identification; that offset is removed.")
        if self.fitted_rms_percent is not None and self.fit.rms_percent > 2.0 * self.fitted_rms_percent:
            yield (f"That is {self.fit.rms_percent / max(self.fitted_rms_percent, 1e-9):.2g} times the {percent(self.fitted_rms_percent)} "
                   f"of the recording that it was identified from.")
        if self.beyond_percent > 1.0:
            yield (f"The drive goes {percent(self.beyond_percent)} of its range beyond what the model was identified over, where "
                   f"the model is a guess.")


def start_in(model: HysteresisCreepModel, recording: Recording) -> OperatorState:
    """States before the first sample of a recording that explain it best; the identification's where these do as well as there.

    Raises
    ------
    IdentificationError
        The sampling period is another one than the model's.
    """
    s = model.structure
    if abs(recording.sample_time / s.sample_time - 1.0) > 1e-3:
        raise IdentificationError(f"{recording.name}: is sampled every {recording.sample_time:g} s and the model every "
                                  f"{s.sample_time:g} s")
    head = head_of(recording, s)
    x, y = head.arrays()

    def cost(state: OperatorState) -> float:
        return float(np.var((model.simulate(x, state.copy()) - y) / s.y_scale))

    fit = model.report.get("fit")
    if model.start is not None and fit is not None:
        error = (model.simulate(x, model.start.copy()) - y)[fit["skipped"]:]
        if error.size and np.sqrt(np.mean(error**2)) <= SAME * fit["rms"]:
            return model.start.copy()
    return find_start(head, s, cost)[0]


def validate(model: HysteresisCreepModel, recording: Recording) -> Validation:
    """Judge a model on a recording; see ``HysteresisCreepModel.validate``."""
    s = model.structure
    for what, own, other in (("input", recording.input_unit, s.input_unit), ("output", recording.output_unit, s.output_unit)):
        if own and other and own != other:
            raise IdentificationError(f"{recording.name}: its {what} is in {own} and that of the model in {other}")
    state, lag = start_in(model, recording), model.report.get("lag")
    start, span = state.copy(), recording.y_range[1] - recording.y_range[0]
    if lag is not None and lag["removed"]:
        recording, _, state = without_lag(recording, s, lag["samples"], 0, state)
    fit, shift = forward_error(model, recording, 0, state, span, free_shift=True)
    reported = model.report.get("fit", {}).get("rms_percent")
    low, high = np.abs(s.unit_input(np.array(recording.x_range)))
    return Validation(fit, shift, start, reported, max(0.0, 50.0 * (float(max(low, high)) - 1.0)), s.output_unit, model.warning)
