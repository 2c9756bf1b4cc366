"""Whether a model of hysteresis and creep is adequate for a recording.

A fit is compared with the best line and the best cubic, on held-out data unless the recording is long. It is refused if
it is no better than the line or has more than twice the error of an explanation outside the model class
(`alternative_models`); the refusal is one sentence that names the explanation. Data on a curve with noise are not
refused: they have no hysteresis, and if the fit is no better than the line, the line is the model, since noise in the
output biases the slope of (6) and not that of the line.

For cross-validation the drive is cut into blocks of equal travel, up or down, or of equal time at rest, so that every
branch of every loop has several blocks and one loop is enough. Line, cubic and model are fitted to every second block
and judged on the others, and vice versa; the operators of the model run through all blocks, and its fit begins with
that to all of them.
"""

import math
from dataclasses import dataclass

import numpy as np

from piezo_model.identification import alternative_models as models
from piezo_model.identification.error_model import Solving, counted_from
from piezo_model.identification.forward import ForwardFit, fit_forward
from piezo_model.identification.report import Baseline, Fit, percent
from piezo_model.identification.start import HEAD, moving_from
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import quantity
from solvers.arrays import Mask, Vector

BLOCKS = 16
"""Blocks for one traverse of the range, up to about MOST_BLOCKS in all."""
FEWEST_BLOCKS, MOST_BLOCKS = 64, 2000
WINDOW = 12_000
"""Samples to which alternative models are fitted."""
MUCH_BETTER = 0.5
"""Largest ratio of an alternative model's error to the model's that counts as better."""
GOOD = 1e-3
"""Error, as a share of the range, below which a model needs no alternative if it also halves that of a line."""
EXACT = 1e-5
"""Largest error of data that lie exactly on a curve, as a share of the range."""
LOOPS = 0.99
"""Largest ratio of the error of a model to that of a curve at which there are loops in the noise."""
WHITE = 0.4
"""Largest correlation of neighbouring samples in noise."""
NOISY = 0.02
"""Smallest error of a curve, as a share of the range, that may be a resonance instead of noise."""
ROUGH = 0.3
"""Roughness of a drive of about eight samples a period."""
NEGLIGIBLE = 0.1
"""Largest ratio of the model's error to the line's at which turning points between samples do not matter."""
REVERSED = -0.5
"""Largest sense of loops in which the output leads."""
STEPS = 2
"""Gauss–Newton steps from the fit to all blocks to that of every second one."""
ONE_WAY = 0.9
"""Smallest share of the drive's travel in one direction that counts as a single branch."""


@dataclass(frozen=True)
class Adequacy:
    """The verdict on a fit."""

    baseline: Baseline
    hysteresis: bool
    straight: bool
    """Whether a line is as good as the model."""
    refusal: str | None
    """The reason against the model, one sentence without its full stop."""
    one_way: bool
    """Whether the data are nearly a single branch."""


def check_adequacy(recording: Recording, fitted: ForwardFit, skip: int, solving: Solving, fit: Fit) -> Adequacy:
    """Compare a fit with a line, a cubic and other explanations of the recording."""
    s = fitted.structure
    moving = moving_from(recording, skip)
    # with many samples and few weights, the error of the fit is near that on held-out data
    held_out = cross_validate(recording, fitted, skip, solving, fit.span) if recording.length <= HEAD else None
    baseline = held_out or Baseline(fit.line_percent, fit.cubic_percent, fit.rms_percent, held_out=False)
    counted = slice(skip, HEAD + moving)
    x, y = recording.x[counted], recording.y[counted]
    own = (y - s.y_centre - s.y_scale * fitted.y_model[counted]) / fit.span
    energy = np.concatenate([[0.0], np.cumsum(own**2)])
    first = (
        int(np.argmax(energy[WINDOW:] - energy[:-WINDOW])) if x.size > WINDOW else 0
    )  # where explanations differ most
    window = slice(first, first + WINDOW)
    stride = math.ceil(x.size / WINDOW)
    u, v = 0.5 + 0.5 * s.unit_input(x), (y - y.mean()) / fit.span
    thin_u, thin_v = u[::stride], v[::stride]
    error, line = baseline.model_percent / 100.0, baseline.line_percent / 100.0
    curve = models.rms(models.residual(models.hats(thin_u), thin_v))
    noise = curve < EXACT or models.is_noise(u[window], models.residual(models.hats(u[window]), v[window]), WHITE)
    monotone = abs(models.rise(thin_u, thin_v)) > 0.8
    hidden = curve < EXACT or error > LOOPS * curve  # loops much smaller than the noise still lower the error
    on_curve = noise and monotone and hidden and curve < min(0.8 * float(v.std()), 1.2 * error + EXACT)
    refusal, at = None, models.outlier(y)
    if at is not None and models.outlier(x) != at:
        refusal = models.outlier_sentence(y, at, skip, s.output_unit)
    elif not on_curve and not (error < GOOD and error < MUCH_BETTER * line):
        refusal = _refusal(u, v, own, window, s, error, line)
    elif on_curve and curve > NOISY:
        resonant = models.resonance(u[window], v[window])
        if resonant.error < MUCH_BETTER * curve:
            refusal = _of_resonance(resonant, s, f"this model leaves {percent(100.0 * error)} of the range")
    on_curve = on_curve and refusal is None
    return Adequacy(baseline, not on_curve, on_curve and not baseline.pays, refusal, is_one_way(thin_u))


def is_one_way(x: Vector) -> bool:
    """Whether a drive (N,) is nearly a single branch."""
    travel = np.diff(x)
    up, down = float(travel[travel > 0].sum()), -float(travel[travel < 0].sum())
    return max(up, down) > ONE_WAY * max(up + down, 1e-300)


def _refusal(
    u: Vector, v: Vector, own: Vector, window: slice, s: ModelStructure, error: float, line: float
) -> str | None:
    """The reason against a model; None without one.

    Alternative models are fitted to all data, thinned, and to a window of consecutive samples.
    """
    stride, channels = math.ceil(u.size / WINDOW), models.channels(u, v, WINDOW)
    thin_u, thin_v, u, v = u[::stride], v[::stride], u[window], v[window]
    no_better, far_better = error >= 0.9 * line, MUCH_BETTER * min(error, line)
    cubic, cubic_in_window = (
        models.rms(models.residual(models.polynomials(2.0 * a - 1.0, 3), b)) for a, b in ((thin_u, thin_v), (u, v))
    )
    compared = f"this model leaves {percent(100.0 * error)} of the range and a straight line {percent(100.0 * line)}"
    noise = no_better and models.correlation(v) < WHITE and line > 0.9 * float(v.std()) and channels.error > far_better
    rough = models.roughness(u) > ROUGH
    undersampled = rough and error > NEGLIGIBLE * line and models.unpredicted(u) < MUCH_BETTER
    if (noise or undersampled) and (resonant := models.resonance(u, v)).error < far_better:
        return _of_resonance(resonant, s, compared)
    if noise:
        return f"the output is noise that does not follow the drive: {compared}"
    if undersampled:
        period = 2.0 * math.pi / math.acos(max(1.0 - models.roughness(u), -1.0))
        return (
            f"the drive is undersampled, with {period:.1f} samples a period, or aliased: its turning points, on which "
            f"hysteresis depends, are lost; {compared}"
        )
    if not rough and error > MUCH_BETTER * line:
        backlash = models.backlash(thin_u, thin_v)
        if backlash.error < far_better:
            width = quantity(2.0 * s.x_scale * backlash.parameter, s.input_unit, 3)
            return (
                f"the output follows the drive with a backlash of {width}, as of a gear or a loose coupling, which "
                f"leaves {percent(100.0 * backlash.error)} of the range: {compared}"
            )
        if models.sense(thin_u, thin_v) < REVERSED:
            if (resonant := models.resonance(u, v)).error < MUCH_BETTER * far_better:
                return _of_resonance(resonant, s, compared)
            phase, frequency = models.phase_lag(u, v)
            if models.is_tonal(u) and phase > 90.0:
                return (
                    f"the output lags by {phase:.0f}° at {frequency / s.sample_time:.3g} Hz, as above a resonance, or "
                    f"falls as the drive rises and leads it, as where the columns are swapped: {compared}"
                )
            return (
                "the output leads the drive round its loops, as where the columns of input and output are swapped: "
                f"{compared}"
            )
    candidates = {"channels": channels, "butterfly": models.butterfly(thin_u, thin_v)}
    if no_better:  # otherwise not: over a single loop, time explains as much as the drive does
        candidates["drift"] = models.drift(thin_v)
    if min(candidates.values()).error > far_better:
        candidates["delay"] = models.delay(thin_u, thin_v)
        resonant = models.resonance(u, v)
        # fitted to the window, so its error is scaled to all data like those of the model or the cubic
        scale = max(models.rms(own) / max(models.rms(own[window]), 1e-300), cubic / max(cubic_in_window, 1e-300))
        candidates["resonance"] = resonant._replace(error=scale * resonant.error)
    name, best = min(candidates.items(), key=lambda candidate: candidate[1])
    if best.error < (far_better if name == "butterfly" else min(far_better, MUCH_BETTER * cubic)):
        left = f"leaves {percent(100.0 * best.error)} of the range where this model leaves {percent(100.0 * error)}"
        if name == "resonance":
            return _of_resonance(best, s, f"it {left}")
        delay = quantity(best.parameter * stride * s.sample_time, "s", 3)
        why = {
            "drift": "the output drifts with time and does not follow the drive",
            "channels": "the output seems to hold two channels in turn, even samples on one curve and odd ones on "
            "another",
            "butterfly": "the output falls and rises again on one way of the drive, as the butterfly of a strain over "
            "a field",
            "delay": f"the output is the drive with a delay of {delay}",
        }
        return f"{why[name]}, which {left}"
    return f"the model class does not describe these data: {compared}" if no_better else None


def _of_resonance(model: models.AlternativeModel, s: ModelStructure, why: str) -> str:
    return f"the output has a resonance at {model.parameter / s.sample_time:.3g} Hz: {why}"


def alternate_blocks(x: Vector) -> Mask:
    """Whether each sample is in an even block, shape (N,)."""
    travel = np.abs(np.diff(x))
    block = max(float(np.ptp(x)) / BLOCKS, float(travel.sum()) / MOST_BLOCKS)
    blocks = np.concatenate([[0.0], np.cumsum(np.maximum(travel / block, FEWEST_BLOCKS / x.size))])
    mask: Mask = blocks.astype(int) % 2 == 0
    return mask


def cross_validate(
    recording: Recording, fitted: ForwardFit, skip: int, solving: Solving, span: float
) -> Baseline | None:
    """Errors of line, cubic and model of a recording on every second block, fitted to the others, per cent of ``span``;
    None with too few samples."""
    s, x, y = fitted.structure, recording.x, recording.y
    even, counted = alternate_blocks(x), counted_from(recording, skip)
    squares = np.zeros(3)
    for inside in (even & counted, ~even & counted):
        held_out = counted & ~inside
        if np.count_nonzero(inside) <= s.d or not held_out.any():
            return None
        errors = [models.residual(models.polynomials(s.unit_input(x), degree), y, inside) for degree in (1, 3)]
        model = fit_forward(recording, inside, s, fitted.state, fitted.v, solving, steps=STEPS)
        errors.append(s.y_scale * model.error)
        squares += [float(np.sum(error[held_out] ** 2)) for error in errors]
    line, cubic, model_error = 100.0 * np.sqrt(squares / np.count_nonzero(counted)) / span
    return Baseline(float(line), float(cubic), float(model_error), held_out=True)
