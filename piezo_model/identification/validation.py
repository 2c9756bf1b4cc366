"""Validation of a model on a recording, which is evidence if its identification has not used it.

The weights stay. The unknowns of the recording are estimated: the states before the first sample (`initial_state`) by
the variance of the output's error, and a constant difference of the outputs by its mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from piezo_model.identification.alternative_models import outlier, outlier_sentence
from piezo_model.identification.fit_report import Fit, percent
from piezo_model.identification.fitting import forward_error
from piezo_model.identification.initial_state import (
    find_initial_state,
    head_of,
    longest_transient,
    transient_end,
    y_range,
)
from piezo_model.identification.sensor_lag import without_lag
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.units import quantity
from solvers.arrays import Vector

if TYPE_CHECKING:
    from piezo_model.model import HysteresisCreepModel

OUTLIER_SAMPLES = 1_000_000
"""Samples from the start in which an outlier is searched for."""
SAME = 1.001
"""Largest ratio of the error to the reported one at which the identification's initial state is kept."""


@dataclass(frozen=True)
class Validation:
    """The errors of a model on a recording."""

    model: HysteresisCreepModel
    fit: Fit
    """The errors as of an identification, with ``shift`` removed."""
    shift: float
    """Constant difference of the outputs, measured minus modelled, output unit."""
    start: OperatorState
    """Estimated states before the first sample."""
    beyond_percent: float
    """Excess of the drive over the range of the identification, per cent of that range."""
    outlier: str
    """A clause about a single outlier of the output; "" without one."""
    units: str
    """What the recording's units needed to be the model's, in a sentence; "" if they are the same."""
    own: bool
    """Whether the model was fitted to exactly these samples."""

    def to_dict(self) -> dict[str, Any]:
        """Numbers and sentences for JSON."""
        return {"fit": asdict(self.fit), "shift": self.shift, "own": self.own, "sentences": list(self.sentences())}

    def sentences(self) -> Iterator[str]:
        """The headline, then the other important sentences."""
        unit = self.model.structure.output_unit
        own = "The model was fitted to this recording, so the errors say little about other recordings." * self.own
        yield from filter(None, (self.model.warning, self.fit.headline(unit, "on this recording"), own, self.units))
        if self.outlier:
            yield f"{self.outlier[0].upper()}{self.outlier[1:]}."
        if self.fit.skipped:
            yield (
                f"The first {self.fit.skipped} samples are not counted: they hold a transient, with an error of up to "
                f"{percent(self.fit.skipped_max_percent)}."
            )
        if abs(self.shift) > 0.1 * self.fit.rms:
            yield (
                f"The output is shifted by a constant {quantity(self.shift, unit, 3)} "
                f"({percent(100.0 * abs(self.shift) / self.fit.span)} of the range) from that of the model; the errors "
                "are without it."
            )
        reported = self.model.report.get("fit", {}).get("rms", math.inf)
        if self.fit.rms > 2.0 * reported:
            yield (
                f"An RMS error of {quantity(self.fit.rms, unit, 2)} is "
                f"{self.fit.rms / max(reported, 1e-11 * self.fit.span):.2g} times the {quantity(reported, unit, 2)} on "
                "the recording that the model was identified from."
            )
        if self.beyond_percent > 1.0:
            yield (
                f"The drive goes {percent(self.beyond_percent)} of its range beyond that of the identification, "
                f"where the model extrapolates; the constant shift is estimated within that range alone."
            )


def start_and_transient(model: HysteresisCreepModel, recording: Recording) -> tuple[OperatorState, int]:
    """The states before the first sample of a recording that fit best, and the number of samples in a transient.

    The identification's states are kept if the error is as small as it was there.
    """
    s = model.structure
    head = head_of(recording, s)
    x, y, longest = head.x, head.counted_y, longest_transient(head, s)

    def error(state: OperatorState, skip: int) -> Vector:
        unit_error: Vector = ((model.simulate(x, state) - y) / (2.0 * s.y_scale))[skip:]
        return unit_error

    def initial(skip: int) -> OperatorState:
        return find_initial_state(head, s, lambda state: float(np.nanvar(error(state, skip))))[0]

    def transient(state: OperatorState, skip: int) -> int:
        centred = np.abs(error(state, 0) - np.nanmedian(error(state, skip)))
        return transient_end(np.nan_to_num(centred), longest) if longest else 0

    fit = model.report.get("fit")
    if model.start is not None and fit is not None:
        own = error(model.start, fit["skipped"])
        if own.size and 2.0 * abs(s.y_scale) * np.sqrt(np.nanmean(own**2)) <= SAME * fit["rms"]:
            return model.start, transient(model.start, fit["skipped"])
    state = initial(0)
    whole = np.abs(np.nan_to_num(error(state, 0)))
    if longest and np.max(whole[:longest]) > np.max(whole[longest:]):
        settled = initial(longest)
        if skip := transient(settled, longest):
            return settled, skip
    return state, 0


def validate(model: HysteresisCreepModel, recording: Recording) -> Validation:
    """Validate a model on a recording; see ``HysteresisCreepModel.validate``."""
    model = model.at(recording.sample_time)
    s, own = model.structure, model.report.get("recording") == recording.digest()
    recording = recording.in_units(s.input_unit, s.output_unit)
    (state, skip), lag = start_and_transient(model, recording), model.report.get("lag")
    (low, high), start = y_range(recording, skip), state
    span = high - low
    if lag is not None and lag["removed"]:
        recording, skip, state = without_lag(recording, s, lag["samples"], skip, state)
    fit, shift = forward_error(model, recording, skip, state, span, free_shift=True)
    y = recording.y[:OUTLIER_SAMPLES]
    farthest = float(np.max(np.abs(s.unit_input(np.array(recording.x_range)))))
    return Validation(
        model,
        fit,
        shift,
        start,
        max(0.0, 50.0 * (farthest - 1.0)),
        "" if (at := outlier(y)) is None else outlier_sentence(y, at, 0, s.output_unit),
        recording.units,
        own,
    )
