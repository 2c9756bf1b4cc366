"""Whether a model of hysteresis and creep is what a recording asks for.

A fit is held against the best line and the best cubic on data left out. No better than the line, or
less than half as good as an explanation that the model class has no part in (`alternative_models`), it is refused in
one sentence that names the explanation. Data that are on a curve and in noise are no reason to refuse: they have no
hysteresis, and where the fit is no better than the line, whose slope noise in the output does not bias as it does that
of (6), the line is the model.

For cross-validation the drive is cut into blocks of a share of its range, travelled up or down, or of time where it
rests, so that every branch of every loop has several and one loop is enough. Each of the three is fitted to every
second block and judged on the others, and the other way round; the operators of the model run through all of them.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from piezo_model.data_basis import DataBasis
from piezo_model.identification import alternative_models
from piezo_model.identification.fit_report import Baseline, Fit, percent
from piezo_model.identification.fitting import optimum
from piezo_model.identification.initial_state import HEAD, moving_from
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import quantity
from solvers.arrays import Mask, Vector

BLOCKS = 16
"""Blocks to a way through the whole range, up to about MOST_BLOCKS in all."""
FEWEST_BLOCKS, MOST_BLOCKS = 64, 2000
LOOK = 12_000
"""Samples that explanations are tried on."""
MUCH_BETTER = 0.5
"""Share of the model's error below which another explanation is the better one."""
GOOD = 1e-3
"""Share of the range: a model that errs less, and less than half as much as a line, needs no other explanation."""
EXACT = 1e-5
"""Share of the range below which data are on a curve exactly."""
WHITE = 0.4
"""Correlation of neighbouring samples up to which an error is noise."""
NOISY = 0.02
"""Share of the range from which on what is left by a curve may be a resonance instead of noise."""
FEW = 0.3
"""Roughness of a drive of about eight samples a period."""
RIGHT = 0.1
"""Share of the line's error below which turns between samples do not matter."""
REVERSED = -0.5
"""Sense of the loops below which the output leads."""
ONE_WAY = 0.9
"""Share of the drive's travel in one direction from which on the data are nearly one branch."""


class Refusal(NamedTuple):
    """What speaks against a model."""

    why: str
    """One sentence without its full stop."""
    explained: float = math.inf
    """Error that the explanation leaves, as a share of the range; infinite where none is known."""


@dataclass(frozen=True)
class Adequacy:
    """Errors on data left out, whether there is hysteresis, whether a line says all, what speaks against a model, and
    whether there is one branch alone."""

    baseline: Baseline
    hysteresis: bool
    straight: bool
    refusal: Refusal | None
    one_way: bool


def check_adequacy(
    recording: Recording,
    model: HysteresisCreepModel,
    skip: int,
    state: OperatorState,
    fit: Fit,
    solver: str,
    proximal: float,
) -> Adequacy:
    """Hold a fit against a line, a cubic and what else would explain the recording."""
    s = model.structure
    moving = moving_from(recording, skip)
    # with many samples to so few weights, the error is that on data left out
    left_out = cross_validate(recording, s, skip, state, solver, proximal) if recording.length <= HEAD else None
    baseline = left_out or Baseline(fit.line_percent, fit.cubic_percent, fit.rms_percent)
    x, y = recording.head(HEAD + moving).arrays()
    own = ((y - model.simulate(x, state.copy())) / fit.span)[skip:]
    x, y = x[skip:], y[skip:]
    first = max(0, min(moving - skip - 1, x.size - LOOK))  # while the drive rests, explanations cannot differ
    look = slice(first, first + LOOK)
    stride = math.ceil(x.size / LOOK)
    u, v = 0.5 + 0.5 * s.unit_input(x), (y - y.mean()) / fit.span
    way = np.diff(u[::stride])
    turned = max(float(way[way > 0].sum()), -float(way[way < 0].sum())) / max(float(np.abs(way).sum()), 1e-300)
    error, line = baseline.model_percent / 100.0, baseline.line_percent / 100.0
    residual = alternative_models.left_over(alternative_models.hats(u[::stride]), v[::stride])
    curve, monotone = alternative_models.rms(residual), abs(alternative_models.rise(u[::stride], v[::stride])) > 0.8
    noise = curve < EXACT or alternative_models.noise(
        u[look], alternative_models.left_over(alternative_models.hats(u[look]), v[look]), WHITE
    )
    on_curve = noise and monotone and curve < min(0.8 * float(v.std()), 1.2 * error + EXACT)
    refusal, at = None, alternative_models.outlier(y)
    if at is not None and alternative_models.outlier(x) != at:
        on_curve, refusal = False, Refusal(alternative_models.outlier_sentence(y, at, skip, s.output_unit))
    elif (
        on_curve
        and curve > NOISY
        and (resonant := alternative_models.resonance(u[look], v[look])).error < MUCH_BETTER * curve
    ):
        on_curve, refusal = (
            False,
            _of_resonance(resonant, s, f"this model leaves {percent(100.0 * error)} of the range"),
        )
    elif not on_curve and not (error < GOOD and error < MUCH_BETTER * line):
        refusal = _refusal(u, v, own, look, s, error, line)
    return Adequacy(baseline, not on_curve, on_curve and not baseline.pays, refusal, turned > ONE_WAY)


def _refusal(
    u: Vector, v: Vector, own: Vector, look: slice, s: ModelStructure, error: float, line: float
) -> Refusal | None:
    """Why there is to be no model; None where there is no reason.

    Explanations are tried on all of the data, thinned, and on the stretch ``look`` of neighbours.
    """
    stride, channels = math.ceil(u.size / LOOK), alternative_models.channels(u, v, LOOK)
    thin_u, thin_v, u, v = u[::stride], v[::stride], u[look], v[look]
    no_better, far_better = error >= 0.9 * line, MUCH_BETTER * min(error, line)
    cubic, cubic_first = (
        alternative_models.rms(alternative_models.left_over(alternative_models.polynomials(2.0 * a - 1.0, 3), b))
        for a, b in ((thin_u, thin_v), (u, v))
    )
    compared = f"this model leaves {percent(100.0 * error)} of the range and a straight line {percent(100.0 * line)}"
    noise = (
        no_better
        and alternative_models.correlation(v) < WHITE
        and line > 0.9 * float(v.std())
        and channels.error > far_better
    )
    few = alternative_models.roughness(u) > FEW
    undersampled = few and error > RIGHT * line and alternative_models.unforeseen(u) < MUCH_BETTER
    if (noise or undersampled) and (resonant := alternative_models.resonance(u, v)).error < far_better:
        return _of_resonance(resonant, s, compared)
    if noise:
        return Refusal(f"the output is noise that does not follow the drive: {compared}")
    if undersampled:
        period = 2.0 * math.pi / math.acos(max(1.0 - alternative_models.roughness(u), -1.0))
        return Refusal(
            f"the drive is undersampled, with {period:.1f} samples a period, or aliased: its turning points, on which "
            f"hysteresis depends, are lost; {compared}"
        )
    seconds = s.sample_time
    if not few and error > MUCH_BETTER * line:
        loose = alternative_models.backlash(thin_u, thin_v)
        if loose.error < far_better:
            width = quantity(2.0 * s.x_scale * loose.found, s.input_unit, 3)
            return Refusal(
                f"the output follows the drive with a backlash of {width}, as of a gear or a loose coupling, which "
                f"leaves {percent(100.0 * loose.error)} of the range: {compared}",
                loose.error,
            )
        if alternative_models.sense(thin_u, thin_v) < REVERSED:
            if (resonant := alternative_models.resonance(u, v)).error < MUCH_BETTER * far_better:
                return _of_resonance(resonant, s, compared)
            late = alternative_models.phase(u, v)
            if alternative_models.tones(u) and late.error > 90.0:
                return Refusal(
                    f"the output lags by {late.error:.0f}° at {late.found / seconds:.3g} Hz, as above a resonance, or "
                    f"falls as the drive rises and leads it, as where the columns are swapped: {compared}"
                )
            return Refusal(
                "the output leads the drive round its loops, as where the columns of input and output are swapped: "
                f"{compared}"
            )
    found = {"channels": channels, "butterfly": alternative_models.butterfly(thin_u, thin_v)}
    if no_better:  # where the model is better than a line: over one loop, time says as much as the drive does
        found["drift"] = alternative_models.drift(thin_v)
    if min(found.values()).error > far_better:
        # of a stretch: to be held against what model and cubic leave of those
        resonance = alternative_models.resonance(u, v)
        fair = max(
            alternative_models.rms(own) / max(alternative_models.rms(own[look]), 1e-300),
            cubic / max(cubic_first, 1e-300),
        )
        found |= {
            "delay": alternative_models.delay(thin_u, thin_v),
            "resonance": resonance._replace(error=fair * resonance.error),
        }
    name, best = min(found.items(), key=lambda each: each[1])
    if best.error < (far_better if name == "butterfly" else min(far_better, MUCH_BETTER * cubic)):
        left = (
            f"which leaves {percent(100.0 * best.error)} of the range where this model leaves {percent(100.0 * error)}"
        )
        if name == "resonance":
            return _of_resonance(best, s, left.replace("which", "it"))
        why = {
            "drift": "the output drifts with time and does not follow the drive",
            "channels": "the output seems to hold two channels in turn, even samples on one curve and odd ones on "
            "another",
            "butterfly": "the output falls and rises again on one way of the drive, as the butterfly of a strain over "
            "a field",
            "delay": f"the output is the drive with a delay of {quantity(best.found * stride * seconds, 's', 3)}",
        }
        return Refusal(f"{why[name]}, {left}", best.error)
    return Refusal(f"the model class does not describe these data: {compared}") if no_better else None


def _of_resonance(found: alternative_models.AlternativeModel, s: ModelStructure, why: str) -> Refusal:
    return Refusal(f"the output has a resonance at {found.found / s.sample_time:.3g} Hz: {why}", found.error)


def alternate_blocks(x: Vector) -> Mask:
    """Whether each sample is in a block of the first kind, shape (N,)."""
    way = np.abs(np.diff(x))
    block = max(float(np.ptp(x)) / BLOCKS, float(way.sum()) / MOST_BLOCKS)
    passed = np.concatenate([[0.0], np.cumsum(np.maximum(way / block, FEWEST_BLOCKS / x.size))])
    mask: Mask = passed.astype(int) % 2 == 0
    return mask


def cross_validate(
    recording: Recording, s: ModelStructure, skip: int, state: OperatorState, solver: str, proximal: float
) -> Baseline | None:
    """Judge line, cubic and model of a recording on every second block, fitted to the others; None where these are too
    few."""
    x, y = recording.arrays()
    first = alternate_blocks(x)
    counted = np.arange(x.size) >= skip
    squares = np.zeros(3)
    for fitted in (first & counted, ~first & counted):
        left_out = counted & ~fitted
        if fitted.sum() <= s.d or not left_out.any():
            return None
        model = HysteresisCreepModel.from_weights(s, _weights(x, y, s, fitted, state, solver, proximal))
        columns = [alternative_models.polynomials(s.unit_input(x), degree) for degree in (1, 3)]
        errors = [alternative_models.left_over(each, y, fitted) for each in columns]
        errors.append(model.simulate(x, state.copy()) - y)
        squares += [float(np.sum(error[left_out] ** 2)) for error in errors]
    span = 2.0 * abs(s.y_scale)
    line, cubic, model_error = 100.0 * np.sqrt(squares / counted.sum()) / span
    return Baseline(float(line), float(cubic), float(model_error))


def _weights(
    x: Vector, y: Vector, s: ModelStructure, fitted: Mask, state: OperatorState, solver: str, proximal: float
) -> Vector:
    basis = DataBasis(s, state)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(fitted)) + 1, [x.size]])
    for start, stop in pairwise(edges):
        basis.update(x[start:stop], y[start:stop], count=bool(fitted[start]))
    return optimum(basis.problem(proximal=proximal), solver)
