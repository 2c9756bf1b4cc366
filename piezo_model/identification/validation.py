"""Validation of a model on a recording, which is evidence if its identification has not used it.

The weights stay. The unknowns of the recording are estimated: the states before the first sample (`start`) by the
variance of the output's error, and a constant difference of the outputs by its mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import piezo_model
from piezo_model.identification.adequacy import outlier
from piezo_model.identification.error_model import States, counted_from, one_thread
from piezo_model.identification.fit_errors import Fit, fit_of
from piezo_model.identification.forward import simulate
from piezo_model.identification.known_start import start_and_transient, was_fitted_to
from piezo_model.identification.start import y_range
from piezo_model.recordings import Recording
from piezo_model.units import percent, quantity

OUTLIER_SAMPLES = 1_000_000
"""Samples from the start in which an outlier is searched for."""
WITHIN, FEWEST_INSIDE = 1.01, 0.2
"""Largest amplitude of a drive within the model's range, and the smallest share of such samples that determines a
shift, since extrapolation has errors of its own."""


@dataclass(frozen=True)
class Validation:
    """The errors of a model on a recording."""

    model: piezo_model.HysteresisCreepModel
    fit: Fit
    """The errors as of an identification, with ``shift`` removed."""
    shift: float
    """Constant difference of the outputs, measured minus modelled, output unit."""
    states: States
    """Estimated states before the first sample of each part."""
    beyond_percent: float
    """Excess of the drive over the range of the identification, per cent of that range."""
    outlier: str | None
    """A clause about a single outlier of the output; None without one."""
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
        reported = self.model.report.get("fit", {}).get("rms", math.inf)
        for applies, sentence in (
            (
                self.fit.skipped,
                f"The first {self.fit.skipped} samples are excluded as a switch-on transient; the error there reaches "
                f"{percent(self.fit.skipped_max_percent)}.",
            ),
            (
                abs(self.shift) > 0.1 * self.fit.rms,
                f"The output is shifted by a constant {quantity(self.shift, unit, 3)} "
                f"({percent(100.0 * abs(self.shift) / self.fit.span)} of the range) from that of the model; the errors "
                "are without it.",
            ),
            (
                self.fit.rms > 2.0 * reported,
                f"An RMS error of {quantity(self.fit.rms, unit, 2)} is "
                f"{self.fit.rms / max(reported, 1e-11 * self.fit.span):.2g} times the {quantity(reported, unit, 2)} on "
                "the recording that the model was identified from.",
            ),
            (
                self.beyond_percent > 1.0,
                f"The drive goes {percent(self.beyond_percent)} of its range beyond that of the identification, "
                "where the model extrapolates; the constant shift is estimated within that range alone.",
            ),
        ):
            if applies:
                yield sentence


@one_thread
def validate(model: piezo_model.HysteresisCreepModel, recording: Recording) -> Validation:
    """Validate a model on a recording; see ``HysteresisCreepModel.validate``."""
    model = model.at(recording.sample_time)
    s, own, seen = model.structure, was_fitted_to(model, recording), model.seen
    states, skip = start_and_transient(seen, recording)
    recording = recording.in_units(s.input_unit, s.output_unit)
    low, high = y_range(recording, skip)
    errors, counted = (
        recording.y - simulate(s, model.arrays, recording, states, seen.dynamics),
        counted_from(recording, skip),
    )
    inside = errors[counted & (np.abs(s.unit_input(recording.x)) <= WITHIN)]
    shift = float(inside.mean()) if inside.size > FEWEST_INSIDE * np.count_nonzero(counted) else 0.0
    farthest = float(np.max(np.abs(s.unit_input(np.array(recording.x_range)))))
    return Validation(
        model,
        fit_of(recording, s, errors - shift, skip, high - low),
        shift,
        states,
        max(0.0, 50.0 * (farthest - 1.0)),
        outlier(recording, slice(OUTLIER_SAMPLES), s.output_unit),
        recording.units,
        own,
    )
