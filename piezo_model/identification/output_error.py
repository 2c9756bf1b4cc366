"""Errors of the output over a recording: of a model, and of the best line and the best cubic beside it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from piezo_model.identification import alternative_models as models
from piezo_model.identification.error_model import counted_from
from piezo_model.identification.forward import simulate
from piezo_model.identification.report import Fit
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording

if TYPE_CHECKING:
    from piezo_model.model import HysteresisCreepModel

BASELINE_SAMPLES = 1_000_000
"""Samples, spread over a longer recording, to which a line and a cubic are fitted."""
WITHIN, FEWEST_INSIDE = 1.01, 0.2
"""Largest unit amplitude of a drive within the model's range, and the smallest share of such samples that determines an
offset."""


def output_error(
    model: HysteresisCreepModel,
    recording: Recording,
    skipped: int,
    state: OperatorState,
    span: float,
    *,
    free_shift: bool = False,
) -> tuple[Fit, float]:
    """Errors over the samples after ``skipped``, per cent of ``span``, and the offset that ``free_shift`` removes.

    The offset is the mean error within the model's range, since extrapolation has errors of its own; 0 if the drive is
    hardly ever there.
    """
    s, counted = model.structure, counted_from(recording, skipped)
    errors = recording.y - simulate(s, model.arrays, recording, state, model.dynamics)
    error, x, y = errors[counted], recording.x[counted], recording.y[counted]
    inside = error[np.abs(s.unit_input(x)) <= WITHIN]
    shift = float(inside.mean()) if free_shift and inside.size > FEWEST_INSIDE * error.size else 0.0
    error = error - shift
    rms, worst = float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error)))
    stride = math.ceil(x.size / BASELINE_SAMPLES)
    u, v = s.unit_input(x[::stride]), s.unit_output(y[::stride])
    constant, slope = np.linalg.lstsq(models.polynomials(u, 1), v, rcond=None)[0].tolist()
    unit_percent = 100.0 * abs(s.y_scale) / span
    line, cubic = (unit_percent * models.rms(models.residual(models.polynomials(u, degree), v)) for degree in (1, 3))
    return Fit(
        samples=error.size,
        skipped=skipped,
        rms_percent=100.0 * rms / span,
        max_percent=100.0 * worst / span,
        rms=rms,
        max=worst,
        skipped_max_percent=100.0 * float(np.max(np.abs(errors[:skipped]), initial=0.0)) / span,
        line_percent=line,
        cubic_percent=cubic,
        line=(constant, slope),
        span=span,
        missing=recording.length - skipped - error.size,
    ), shift
