"""A stage with modes, integrated in state space on a grid sixteen times finer, and drives for it; it imports nothing of
the implementation under test but the simulated actuators."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from piezo_model import plants

Vector = NDArray[np.float64]
FINE = 16
T = 1e-4


def through_modes(
    v: Vector,
    modes: Sequence[tuple[float, float, float]],
    delay_s: float = 0.0,
    sample_time: float = T,
    level: float | None = None,
) -> Vector:
    """Output at the end of each sampling period, less a delay that is a multiple of its sixteenth, for a held static
    output v (N,); ``modes`` are frequency in Hz, damping and share of the static gain."""
    h, level = sample_time / FINE, float(v[0]) if level is None else level
    held = np.repeat(v, FINE) - level
    y = (1.0 - sum(gain for *_, gain in modes)) * held
    for f, zeta, gain in modes:
        w = 2.0 * np.pi * f
        A, B = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([[0.0], [w * w]])
        A, B, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), h)
        a, pulse, state = np.array([1.0, -np.trace(A), np.linalg.det(A)]), [], B[:, 0]
        for _ in range(3):
            pulse.append(state[0])
            state = A @ state
        y += lfilter(gain * np.convolve(a, pulse)[:3], a, held)
    late = round(delay_s / h)
    return np.concatenate([np.zeros(late), y])[FINE - 1 : y.size : FINE] + level


def recorded(
    kind: str,
    x: Vector,
    modes: Sequence[tuple[float, float, float]],
    delay_s: float = 0.0,
    noise_um: float = 0.0,
    seed: int = 0,
    sample_time: float = T,
) -> Vector:
    """Output of a simulated actuator with modes, µm."""
    y = through_modes(plants.get(kind, sample_time=sample_time).run(x), modes, delay_s, sample_time)
    return y + noise_um * np.random.default_rng(seed).standard_normal(y.size)


def steps(size: int, seed: int, hold_s: float = 0.02, sample_time: float = T) -> Vector:
    """Random levels of the whole range, V, from its low end on, each held for a time."""
    held = round(hold_s / sample_time)
    levels = np.random.default_rng(seed).uniform(0.0, 150.0, size // held + 1)
    levels[0] = 0.0
    return np.repeat(levels, held)[:size]
