"""Simulated recordings of kinds that the model class can and cannot describe; all other properties are random."""

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from piezo_model import signals
from piezo_model.operators import play
from piezo_model.recordings import Recording
from solvers.arrays import Vector

SAMPLE_TIME = 1e-3


def drive(rng: Generator, size: int = 6000, form: int | None = None) -> Vector:
    """One of six forms of drive between −1 and 1: sines, a swelling sine, triangles, two tones, a decaying one, a
    random walk."""
    t, cycles = np.arange(size) / size, rng.uniform(2.5, 20.0)
    phase = 2 * np.pi * (cycles * t + rng.uniform())
    forms: tuple[Callable[[], Vector], ...] = (
        lambda: np.sin(phase),
        lambda: np.sin(phase) * (0.3 + 0.7 * t),
        lambda: 2 / np.pi * np.arcsin(np.sin(phase)),
        lambda: 0.6 * np.sin(phase) + 0.4 * np.sin(0.37 * phase + 1.0),
        lambda: np.sin(phase) * np.exp(-2 * t),
        lambda: np.sin(np.cumsum(lfilter([0.03], [1.0, -0.97], rng.standard_normal(size))) / 20),
    )
    return forms[int(rng.integers(6)) if form is None else form]()


def loops(rng: Generator, u: Vector, share: float | None = None) -> Vector:
    """Prandtl–Ishlinskii loops of a given width, as a share of the range, computed without the code of the model."""
    share, r = rng.uniform(0.05, 0.3) if share is None else share, np.linspace(0.05, 0.9, 12)
    w = np.exp(-r / rng.uniform(0.2, 0.6))
    z, y = u[0] + rng.uniform(-1, 1) * r, np.empty_like(u)
    for k, value in enumerate(u):
        z = np.minimum(np.maximum(z, value - r), value + r)
        y[k] = w @ z
    return np.asarray((1 - share) * u + share * y / w.sum() * 1.5)


def creeping(rng: Generator, u: Vector) -> Vector:
    y, out = loops(rng, u), np.zeros_like(u)
    for rate in (20.0, 2.0, 0.3):
        a = -np.expm1(-rate * SAMPLE_TIME)
        out += lfilter([0.0, a], [1.0, a - 1.0], u, zi=[(1 - a) * u[0]])[0]
    return y + rng.uniform(0.01, 0.05) * out


def resonant(u: Vector, frequency: float, damping: float, sample_time: float = SAMPLE_TIME) -> Vector:
    """Output of a resonance, exact for an input that is held between the samples."""
    w = 2.0 * np.pi * frequency * sample_time
    a, b = 2.0 * np.exp(-damping * w) * np.cos(w * np.sqrt(1.0 - damping**2)), -np.exp(-2.0 * damping * w)
    return np.asarray(lfilter([0.0, 1.0 - a - b], [1.0, -a, -b], u))


def noisy(rng: Generator, y: Vector, share: float = 0.003) -> Vector:
    return y + share * np.ptp(y) * rng.standard_normal(y.size)


Kind = Callable[[Generator], tuple[Vector, Vector]]


def _on(form: Callable[[Generator, Vector], Vector], drive_form: int | None = None, noise: float = 0.003) -> Kind:
    def kind(rng: Generator) -> tuple[Vector, Vector]:
        u = drive(rng, form=drive_form)
        return u, noisy(rng, form(rng, u), noise)

    return kind


def _staircase(rng: Generator) -> tuple[Vector, Vector]:
    u = signals.staircase(duration_s=6.0, sample_time=SAMPLE_TIME, low=-1.0, high=1.0, levels=int(rng.integers(6, 12)))
    return u, noisy(rng, creeping(rng, u))


def _one_loop(rng: Generator) -> tuple[Vector, Vector]:
    u = np.cos(2 * np.pi * (np.arange(5000) / 5000 * rng.uniform(0.98, 1.3) + rng.uniform()))
    return u, noisy(rng, creeping(rng, u), 0.001)


def _slow_and_late(rng: Generator) -> tuple[Vector, Vector]:
    """A sine of varying amplitude and the same with a phase lag; 12 000 samples are only a short arc of one cycle."""
    k = np.arange(int(rng.integers(60_000, 120_000)))
    period, late = rng.uniform(0.05, 0.5) * k.size, rng.uniform(0.02, 0.9)
    size, phase = (
        1.0 + rng.uniform(0.05, 0.95) * np.sin(2 * np.pi * k / (period * rng.uniform(3.0, 20.0))),
        2 * np.pi * rng.uniform(),
    )
    u, y = (0.5 * size * np.sin(2 * np.pi * k / period + phase - shift) for shift in (0.0, late))
    return u, noisy(rng, y, 10.0 ** rng.uniform(-5.0, -3.0))


DESCRIBABLE: dict[str, Kind] = {
    "hysteresis": _on(loops),
    "hysteresis and creep": _on(creeping),
    "saturation and hysteresis": _on(lambda rng, u: np.tanh(rng.uniform(0.6, 1.5) * loops(rng, u))),
    "saturation without hysteresis": _on(lambda rng, u: np.tanh(rng.uniform(0.8, 2.5) * u)),
    "a straight line": _on(lambda rng, u: 3.0 * u + 1.0, noise=0.0),
    "a straight line in noise": _on(lambda rng, u: 3.0 * u + 1.0, noise=0.05),
    "a straight line of a coarse sensor": _on(lambda rng, u: np.round(100.0 * u), noise=0.0),
    "a straight line and a drift": _on(lambda rng, u: 3.0 * u + np.linspace(0.0, 0.3, u.size), drive_form=5),
    "a falling output": _on(lambda rng, u: -creeping(rng, u)),
    "one loop": _one_loop,
    "a staircase": _staircase,
    "an amplifier that clips": _on(lambda rng, u: np.clip(loops(rng, u), -0.6, 0.7)),
    "a slow sine and a lag": _slow_and_late,
}


def _friction(rng: Generator) -> tuple[Vector, Vector]:
    """Loops that turn the other way, as those of sliding parts, dampers and shape memory."""
    u = drive(rng, form=int(rng.integers(4)))
    return u, noisy(rng, 2.0 * u - loops(rng, u, rng.uniform(0.5, 0.9)), 0.001)


def _interleaved(rng: Generator) -> tuple[Vector, Vector]:
    u = drive(rng, form=int(rng.integers(5)))
    first, second = loops(rng, u), rng.uniform(-0.5, 0.7) * loops(rng, u) + rng.uniform(-2, 2)
    return u, noisy(rng, np.where(np.arange(u.size) % 2, first, second))


def _aliased(rng: Generator) -> tuple[Vector, Vector]:
    """A drive of two to four samples a period, or less than two, so that its turning points are not sampled."""
    fine, size = 200, 3000
    k = np.arange(size * fine) / fine
    u = np.sin(2 * np.pi * rng.choice([rng.uniform(0.26, 0.45), rng.uniform(0.55, 0.74)]) * k) * (
        0.9 + 0.1 * np.sin(2 * np.pi * k / size)
    )
    y = 0.7 * u + 0.15 * play(u, [0.15, 0.3, 0.45, 0.6], [0.0] * 4)[0].sum(axis=1)
    return u[::fine], noisy(rng, y[::fine], 0.001)


UNDESCRIBABLE: dict[str, tuple[Kind, str]] = {
    "friction": (_friction, "does not describe"),
    "white noise": (lambda rng: (drive(rng), rng.standard_normal(6000)), "does not describe"),
    "constant output": (lambda rng: (drive(rng), np.full(6000, 1.7)), "constant"),
    "drift only": (
        lambda rng: (
            drive(rng, form=int(rng.integers(3))),
            noisy(rng, np.linspace(0, 1, 6000) ** rng.uniform(0.5, 2.0)),
        ),
        "does not describe",
    ),
    "two interleaved channels": (_interleaved, "does not describe"),
    "aliased": (_aliased, "samples a period"),
}


def recording(kind: Kind, seed: int) -> Recording:
    x, y = kind(np.random.default_rng(seed))
    return Recording.from_arrays(75.0 + 70.0 * x, 3.0 + 8.0 * y, SAMPLE_TIME, input_unit="V", output_unit="um")
