"""A stage with modes, integrated on a grid sixteen times finer, and drives for it; it imports nothing of
the implementation under test but the simulated actuators."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from piezo_model import plants

Vector = NDArray[np.float64]
FINE = 16
T = 1e-4


class RingingStage:
    """A simulated actuator with modes, sample by sample: output at the end of each sampling period, less a delay that
    is a multiple of its sixteenth; ``modes`` are frequency in Hz, damping and share of the static gain. Without an
    actuator the drive is the static output."""

    def __init__(
        self,
        kind: str | None,
        modes: Sequence[tuple[float, float, float]],
        delay_s: float = 0.0,
        sample_time: float = T,
        level: float | None = None,
    ) -> None:
        self._plant = None if kind is None else plants.get(kind, sample_time=sample_time)
        h = sample_time / FINE
        self._rest, self._level, self._filters = 1.0 - sum(gain for *_, gain in modes), level, []
        for f, zeta, gain in modes:
            w = 2.0 * np.pi * f
            (b,), a, _ = cont2discrete(([gain * w * w], [1.0, 2.0 * zeta * w, w * w]), h)
            self._filters.append([b[1:], a, np.zeros(2)])  # at the end of each period
        self._late = np.zeros(round(delay_s / h))

    def run(self, x: Vector) -> Vector:
        """Continue with a drive (N,)."""
        v = x if self._plant is None else self._plant.run(x)
        self._level = float(v[0]) if self._level is None else self._level
        held = np.repeat(v, FINE) - self._level
        y = self._rest * held
        for part in self._filters:
            moved, part[2] = lfilter(part[0], part[1], held, zi=part[2])
            y += moved
        y = np.concatenate([self._late, y])
        self._late = y[y.size - self._late.size :] if self._late.size else self._late
        return y[FINE - 1 : held.size : FINE] + self._level

    def step(self, x: float) -> float:
        """Continue with one sample."""
        return float(self.run(np.array([x]))[0])


def through_modes(
    v: Vector,
    modes: Sequence[tuple[float, float, float]],
    delay_s: float = 0.0,
    sample_time: float = T,
    level: float | None = None,
) -> Vector:
    """Output of modes for a held static output v (N,)."""
    return RingingStage(None, modes, delay_s, sample_time, level).run(v)


def on_a_spring(
    v: Vector, f: float, zeta: float, hardening: float, *, with_position: bool, sample_time: float = T
) -> Vector:
    """Output of a mode for a held static output v (N,); the stiffness rises by the share ``hardening`` from the middle
    of the range to its end, or with the square of the deflection, which is 1 at half the range."""
    h, w, middle, half = sample_time / FINE, 2.0 * np.pi * f, 0.5 * (v.min() + v.max()), 0.5 * np.ptp(v)
    y, speed, output = float(v[0]), 0.0, np.empty_like(v)
    for i, target in enumerate(v.tolist()):
        for _ in range(FINE):
            deflection = target - y
            harder = (y - middle) / half if with_position else (deflection / half) ** 2
            speed += h * (w * w * (1.0 + hardening * harder) * deflection - 2.0 * zeta * w * speed)
            y += h * speed
        output[i] = y
    return output


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
    y = RingingStage(kind, modes, delay_s, sample_time).run(x)
    return y + noise_um * np.random.default_rng(seed).standard_normal(y.size)


def steps(size: int, seed: int, hold_s: float = 0.02, sample_time: float = T) -> Vector:
    """Random levels of the whole range, V, from its low end on, each held for a time."""
    held = round(hold_s / sample_time)
    levels = np.random.default_rng(seed).uniform(0.0, 150.0, size // held + 1)
    levels[0] = 0.0
    return np.repeat(levels, held)[:size]
