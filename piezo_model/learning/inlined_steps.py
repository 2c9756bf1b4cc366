"""What the learners' compiled steps still inline of the operators, the data basis and the compensator.

Each function is the one of its name in ``core/operators.h``, ``regressors.h``, ``data_basis.c`` or ``compensator.c``, with the
same operations in the same order, so that a loop gives the same bits whether a sample goes through here or through the core.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from piezo_model.compensator import BUMP, DECAY, FARTHEST, LAST_Y_REF, DriveLimits
from piezo_model.data_basis import BLOCK, FILLED, SAMPLES, X_MAX, X_MIN, Y_MAX, Y_MIN, BasisArrays
from piezo_model.inverse_model import InverseArrays
from piezo_model.operator_state import OperatorArrays, SuperpositionArrays
from piezo_model.regressors import RegressorArrays
from solvers.compiled import inlined, kernel
from solvers.vector8 import load8, splat8, store8, sum8

Vector = NDArray[np.float64]


@kernel
def play_step(x: float, r: float, z: float) -> float:
    """Output, and new state, of the play operator with threshold r ≥ 0 at the sample x.

    A sample that is NaN leaves the state where it is: max and min return their first argument then.
    """
    return max(min(z, x + r), x - r)


@kernel
def creep_step(x: float, r: float, a: float, z: float) -> float:
    """State of the creep operator one sampling period after x, with a = 1 − e^(−rate·Ts)."""
    return z + a * (play_step(x, r, z) - z)


@kernel
def dead_zone_step(u: float, low: float, high: float) -> float:
    """Output of the dead zone between two limits; one-sided ones have the other limit at infinity."""
    return max(0.0, u - high) + min(0.0, u - low)


@inlined
def superposition(u: float, S: SuperpositionArrays) -> float:
    """S[u] = Σ w_i S_ri(u)."""
    total = splat8(0.0)
    for i in range(0, S.w.size, 8):
        total = total + load8(S.w, i) * dead_zone_step(splat8(u), load8(S.low, i), load8(S.high, i))
    return sum8(total)


@inlined
def advance(p: OperatorArrays, x: float, play: Vector, creep: Vector) -> None:
    """Move the states on by the sample x that the actuator really saw."""
    lanes = p.r.size
    for i in range(0, lanes, 8):
        r = load8(p.r, i)
        store8(play, i, play_step(splat8(x), r, load8(play, i)))
        for j in range(p.rates):
            at = j * lanes + i
            store8(creep, at, creep_step(splat8(x), r, load8(p.a, at), load8(creep, at)))


@inlined
def regressor_step(p: RegressorArrays, x: float, y: float, play: Vector, creep: Vector, rows: Vector, at: int) -> None:
    """Write the row (x, Ξ) of one sample to ``rows[at:]`` and move the operator states on.

    Blocks are written from left to right, so that each one overwrites the padding of the one before it.
    """
    lanes = p.operators.r.size
    vx, vy = splat8(x), splat8(y)
    for i in range(0, lanes, 8):
        play_i = play_step(vx, load8(p.operators.r, i), load8(play, i))
        store8(play, i, play_i)
        store8(rows, at + i, play_i)
    column = at + p.n + 1
    for i in range(0, p.dead_zones.w.size, 8):
        inner = dead_zone_step(vy, load8(p.dead_zones.low, i), load8(p.dead_zones.high, i))
        store8(rows, column + i, dead_zone_step(vy, load8(p.outer.low, i), load8(p.outer.high, i)) - inner)
    if p.operators.rates > 0:
        column = at + p.width - p.offset - p.n - 1
        for i in range(0, lanes, 8):
            r, total = load8(p.operators.r, i), splat8(0.0)
            for j in range(p.operators.rates):
                z = load8(creep, j * lanes + i)
                total = total + z
                store8(creep, j * lanes + i, creep_step(vx, r, load8(p.operators.a, j * lanes + i), z))
            store8(rows, column + i, total)
    if p.offset:
        rows[at + p.width - 1] = 1.0


@kernel
def _add_rows(p: RegressorArrays, rows: Vector, count: int, stride: int, forgetting: float, gram: Vector) -> None:
    """gram ← λ^N gram + Σ λ^(N−1−k) row_k row_kᵀ, upper triangle, in tiles of four rows by eight columns."""
    if forgetting != 1.0:
        weight = 1.0
        for k in range(count - 1, -1, -1):
            for i in range(k * stride, k * stride + stride, 8):
                store8(rows, i, load8(rows, i) * np.sqrt(weight))
            weight *= forgetting
        for i in range(0, gram.size, 8):
            store8(gram, i, load8(gram, i) * weight)
    for i in range(0, p.width, 4):
        for j in range(i, p.width, 8):
            sum_0 = sum_1 = sum_2 = sum_3 = splat8(0.0)
            for at in range(0, count * stride, stride):
                right = load8(rows, at + j)
                sum_0 = sum_0 + splat8(rows[at + i]) * right
                sum_1 = sum_1 + splat8(rows[at + i + 1]) * right
                sum_2 = sum_2 + splat8(rows[at + i + 2]) * right
                sum_3 = sum_3 + splat8(rows[at + i + 3]) * right
            at = i * stride + j
            store8(gram, at, load8(gram, at) + sum_0)
            store8(gram, at + stride, load8(gram, at + stride) + sum_1)
            store8(gram, at + 2 * stride, load8(gram, at + 2 * stride) + sum_2)
            store8(gram, at + 3 * stride, load8(gram, at + 3 * stride) + sum_3)


@inlined
def count_step(b: BasisArrays, x: float, y: float) -> None:
    """Count one sample in unit amplitudes and move the operator states on; a full block goes into the Gram matrix."""
    if b.counts[SAMPLES] == 0:
        for i in range(b.play.size):
            b.start_play[i] = play_step(x, b.regressors.operators.r[i], b.play[i])
        for i in range(b.creep.size):
            b.start_creep[i] = b.creep[i]
    regressor_step(b.regressors, x, y, b.play, b.creep, b.rows, b.counts[FILLED] * b.stride)
    b.counts[SAMPLES] += 1
    b.counts[FILLED] += 1
    if b.counts[FILLED] == BLOCK:
        _add_rows(b.regressors, b.rows, BLOCK, b.stride, b.forgetting, b.gram)
        b.counts[FILLED] = 0
    b.span[X_MIN], b.span[X_MAX] = min(b.span[X_MIN], x), max(b.span[X_MAX], x)
    b.span[Y_MIN], b.span[Y_MAX] = min(b.span[Y_MIN], y), max(b.span[Y_MAX], y)


@kernel
def set_weights(p: InverseArrays, weights: Vector) -> None:
    """Invert the model of these weights into the arrays; they must be those of a valid model."""
    for i in range(weights.size):
        p.weights[i] = weights[i]
    W, r = weights[0], 0.0
    p.w_H[0], p.W_H[0], p.w_H_inverse[0] = W, W, 1.0 / W
    for i in range(1, p.thresholds):
        r += W * (p.operators.r[i] - p.operators.r[i - 1])  # Σ_{j≤i} w_j (r_i − r_j), summed by parts
        before = W
        W += weights[i]
        p.w_H[i], p.W_H[i] = weights[i], W
        p.w_H_inverse[i], p.r_H_inverse[i] = -weights[i] / (W * before), r
    for i in range(p.zones):
        p.S_inverse.w[i] = weights[p.thresholds + i]
    first, lanes = p.thresholds + p.zones, p.operators.r.size
    for j in range(p.operators.rates):
        for i in range(p.thresholds):
            p.w_K[j * lanes + i] = weights[first + i]


@inlined
def wanted_drive(p: InverseArrays, y_ref: float, play: Vector, creep: Vector) -> float:
    """Drive that makes the model's next output y_ref, without any limit; moves no state on. All in unit amplitudes."""
    K = splat8(0.0)
    for i in range(0, creep.size, 8):
        K = K + load8(p.w_K, i) * load8(creep, i)
    u = superposition(y_ref, p.S_inverse) - sum8(K) - p.weights[p.weights.size - 1]
    x = p.w_H_inverse[0] * u
    outside = 0.0
    for i in range(p.thresholds - 1, 0, -1):
        state = p.W_H[i] * play[i] + outside
        outside += p.w_H[i] * play[i]
        x += p.w_H_inverse[i] * play_step(u, p.r_H_inverse[i], state)
    return x


@inlined
def unit_reference(p: DriveLimits, y_ref: float) -> float:
    """A finite reference in unit amplitudes, far-away ones brought near."""
    return max(-FARTHEST, min(FARTHEST, (y_ref - p.y_centre) / p.y_scale))


@inlined
def within_limits(p: DriveLimits, x: float) -> float:
    """Unit drive inside the limits."""
    return max(p.unit_low, min(p.unit_high, x))


@inlined
def drive_step(p: InverseArrays, limits: DriveLimits, y_ref: float, play: Vector, creep: Vector, fade: Vector) -> float:
    """Drive sample in the input unit for one reference sample in the output unit; moves the states on.

    A reference that is not finite holds the drive where it is.
    """
    last = play[0]
    x = last
    if math.isfinite(y_ref):
        fade[LAST_Y_REF] = y_ref
        x = wanted_drive(p, unit_reference(limits, y_ref), play, creep) + fade[BUMP]
        fade[BUMP] *= fade[DECAY]
        x = max(last - limits.max_step, min(last + limits.max_step, x))
    x = limits.x_centre + limits.x_scale * within_limits(limits, x)
    x = max(limits.low, min(limits.high, x))  # rounding may have passed a limit by its last bit
    advance(p.operators, (x - limits.x_centre) / limits.x_scale, play, creep)
    return x


@inlined
def hand_over_step(p: InverseArrays, limits: DriveLimits, weights: Vector, play: Vector, creep: Vector,
                   fade: Vector) -> None:
    """Take new weights over without a bump: what they would drive differently at this moment is added and fades away."""
    y_ref = unit_reference(limits, fade[LAST_Y_REF])
    before = within_limits(limits, wanted_drive(p, y_ref, play, creep))
    set_weights(p, weights)
    fade[BUMP] += before - within_limits(limits, wanted_drive(p, y_ref, play, creep))
