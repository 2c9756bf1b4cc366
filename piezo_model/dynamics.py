"""Structural dynamics behind the model of hysteresis and creep, and their causal inverse:

    y = G · S[ H[x_a] + K[x_a] + offset ],   T_a dx_a/dt + x_a = x,

    G(s) = e^(−τs) ( Σ g_i ω_i² / (s² + 2 ζ_i ω_i s + ω_i²) + 1 − Σ g_i )

with at most two modes ω_i = 2π f_i. Their gains g_i are shares of the static gain; the rest is residual compliance,
from modes far above the driven band. T_a is the lag of the amplifier, and τ the delay of the output.

G is discretised exactly for an input that is held between samples, with the output at the end of the interval: y(k) is
the output at time (k + 1) T − τ. So τ = T for a sensor that is read while the next drive is written. The residual
compliance has no memory; for it a fraction of τ is interpolated linearly, which is exact for ramps.

The inverse F replaces the poles of each mode by those of the same frequency with a damping ratio of 0.7:

    F(z) = Π  D_i(z) / D_i(1) · R_i(1) / R_i(z),    R = G F, the reference model

The zeros and the delay of G are not inverted, since the inverse would ring or be non-causal; the output follows R with
the lag of its group delay at frequency 0, which is the same for all slow references.

Source: K. J. Åström and B. Wittenmark, Computer-Controlled Systems, 3rd edition 1997, section 2.3, for the hold
with a fractional delay; S. Devasia, E. Eleftheriou and S. O. R. Moheimani, "A survey of control issues in
nanopositioning", IEEE Transactions on Control Systems Technology 15 (2007) 802–823, for inversion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.core import Immutable, bindings
from piezo_model.json_file import LARGEST, Number
from piezo_model.units import quantity
from solvers.arrays import Matrix, Vector

REFERENCE_DAMPING = 0.7
LOWEST, HIGHEST = 1e-4, 0.35
"""Lowest and highest frequency of a mode, relative to the sampling rate; slower modes are lost in rounding."""
SLOWEST = 1e-6
"""Frequency of a mode that a model leaves out, of which the same holds in a loop around the stage."""
LONGEST = 10_000
"""Longest delay and lag in samples."""
MOST_MODES = 2
MARGIN = 4000
"""Samples by which a signal is mirrored at its ends before a Fourier transform."""


@dataclass(frozen=True)
class Dynamics(Immutable):
    """Modes, delay and lag of a stage.

    Parameters
    ----------
    frequencies_Hz : sequence of float
        Undamped frequencies of at most two modes, ascending; none for a delay or a lag alone.
    damping : sequence of float
        Damping ratio of each mode, above 0 and below 1.
    gains : sequence of float
        Positive share of each mode in the static gain, at most 1 in total.
    delay_s : float
        Delay τ of the output from the end of the sampling interval.
    amplifier_lag_s : float
        Time constant of a first-order amplifier before the actuator.

    Raises
    ------
    ValueError
        A value is out of range; the message names it.

    Examples
    --------
    >>> dynamics = Dynamics((500.0,), (0.01,), (1.0,), delay_s=0.0)
    >>> step = np.concatenate([[0.0], np.ones(2000)])
    >>> y = dynamics.filter(step, 1e-4)  # a resonance overshoots, and settles at the static gain
    >>> bool(y.max() > 1.9), bool(abs(y[-1] - 1.0) < 0.01)
    (True, True)
    >>> y = dynamics.filter(dynamics.inverse(step, 1e-4), 1e-4)  # behind the inverse it does not ring
    >>> bool(y.max() < 1.1), f"{1e3 * dynamics.lag_s(1e-4):.2f} ms"
    (True, '0.40 ms')
    """

    frequencies_Hz: tuple[float, ...]
    damping: tuple[float, ...]
    gains: tuple[float, ...]
    delay_s: float
    amplifier_lag_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frequencies_Hz", "damping", "gains"):
            object.__setattr__(self, name, tuple(checks.vectors(**{name: getattr(self, name)})[0].tolist()))
        checks.require(
            lambda f: len(f) <= MOST_MODES and all(a < b for a, b in pairwise((0.0, *f, math.inf))),
            f"at most {MOST_MODES} positive numbers in ascending order",
            frequencies_Hz=self.frequencies_Hz,
        )
        as_many = "as many numbers as there are frequencies, "
        checks.require(
            lambda zeta: len(zeta) == len(self.frequencies_Hz) and all(0.0 < z < 1.0 for z in zeta),
            f"{as_many}above 0 and below 1",
            damping=self.damping,
        )
        checks.require(
            lambda g: len(g) == len(self.frequencies_Hz) and all(a > 0.0 for a in g) and sum(g) <= 1.0 + 1e-12,
            f"{as_many}above 0 and at most 1 in all",
            gains=self.gains,
        )
        for name in ("delay_s", "amplifier_lag_s"):
            checks.require(lambda t: 0.0 <= t <= LARGEST, f"from 0 to {LARGEST:g} s", **{name: getattr(self, name)})
            object.__setattr__(self, name, float(getattr(self, name)))

    def check_sample_time(self, sample_time: float) -> None:
        """Raise ValueError if a mode is too fast or slow, or the delay or lag too long, for a sampling period in s."""
        for f in self.frequencies_Hz:
            if not LOWEST <= f * sample_time <= HIGHEST:
                beyond = f"above {HIGHEST:.0%}" if f * sample_time > HIGHEST else f"below {LOWEST:.2%}"
                raise ValueError(
                    f"the resonance at {quantity(f, 'Hz', 3)} is {beyond.replace('%', ' %')} of the sampling rate, "
                    f"{quantity(1.0 / sample_time, 'Hz', 3)}"
                )
        for what, late_s in (("a delay", self.delay_s), ("an amplifier lag", self.amplifier_lag_s)):
            if late_s > LONGEST * sample_time:
                raise ValueError(
                    f"{what} of {quantity(late_s, 's', 3)} is longer than {LONGEST} sampling periods of "
                    f"{quantity(sample_time, 's', 3)}"
                )

    def below(self, sample_time: float) -> Dynamics:
        """The dynamics with each mode that is too fast for a sampling period in s reduced to its static gain."""
        n = sum(f * sample_time <= HIGHEST for f in self.frequencies_Hz)
        return replace(self, frequencies_Hz=self.frequencies_Hz[:n], damping=self.damping[:n], gains=self.gains[:n])

    def filter(self, v: ArrayLike, sample_time: float, level: float | None = None) -> Matrix:
        """The output of G (N,) for the output v (N,) of the static model, or for columns (N, k) of such outputs.

        Before the first sample it is in equilibrium at ``level``, by default at that sample.
        """
        return self.stream(sample_time, level)(np.asarray(v, dtype=np.float64))

    def stream(self, sample_time: float, level: float | None = None) -> Stream:
        """A filter like :meth:`filter` for consecutive chunks of a signal."""
        whole, sections = self._sections(sample_time)
        return Stream([(np.concatenate([np.zeros(int(whole)), b]), a) for b, a in sections], level)

    def amplified(self, x: Vector, sample_time: float, level: float | None = None) -> Vector:
        """The drive x_a (N,) behind the amplifier for x (N,), with an equilibrium at ``level`` before it."""
        if self.amplifier_lag_s == 0.0:
            return x
        p = math.exp(-sample_time / self.amplifier_lag_s)
        return Stream([(np.array([1.0 - p]), np.array([1.0, -p]))], level)(x)

    def inverse(self, y_ref: ArrayLike, sample_time: float, level: float | None = None) -> Vector:
        """F y_ref (N,): the output of the static model for which the stage does not ring."""
        y = np.asarray(y_ref, dtype=np.float64)
        for D, R in self.pole_pairs(sample_time):
            y = Stream([(D / R[0], R / R[0])], level)(y)
        return y

    def lag_s(self, sample_time: float) -> float:
        """Time by which the output G F y_ref behind the inverse lags a slow reference, with that of the amplifier."""
        return (self.amplifier_samples(sample_time) + self.delay_behind_inverse(sample_time)) * sample_time

    def amplifier_samples(self, sample_time: float) -> float:
        """Samples by which the amplifier delays a ramp."""
        periods = sample_time / self.amplifier_lag_s if self.amplifier_lag_s else math.inf
        return -math.exp(-periods) / math.expm1(-periods)

    def delay_behind_inverse(self, sample_time: float) -> float:
        """Samples by which G F delays a slow signal."""
        whole, N = self.zeros(sample_time)
        return whole + float(np.arange(N.size) @ N - sum(np.arange(3) @ R for _, R in self.pole_pairs(sample_time)))

    def zeros(self, sample_time: float) -> tuple[int, Vector]:
        """Whole samples of the delay, and N(z) / N(1) of G = z^(−delay) N(z) / Π D_i(z); with Π R_i(1) / R_i(z) these
        are the reference model."""
        whole, sections = self._sections(sample_time)
        poles = [a / a.sum() for _, a in sections]
        over = [reduce(np.convolve, poles[:i] + poles[i + 1 :], b / a.sum())[::-1] for i, (b, a) in enumerate(sections)]
        return int(whole), np.asarray(reduce(np.polyadd, over))[::-1]

    def pole_pairs(self, sample_time: float) -> list[tuple[Vector, Vector]]:
        """D_i(z) / D_i(1) and R_i(z) / R_i(1) of each mode, three coefficients each."""
        ringing = (poles(*mode, sample_time) for mode in zip(self.frequencies_Hz, self.damping, strict=True))
        damped = (poles(f, REFERENCE_DAMPING, sample_time) for f in self.frequencies_Hz)
        return [(D / D.sum(), R / R.sum()) for D, R in zip(ringing, damped, strict=True)]

    def response(self, frequencies_Hz: Vector, sample_time: float) -> Vector:
        """Complex response of G at frequencies (k,)."""
        q, (whole, sections) = -2j * np.pi * frequencies_Hz * sample_time, self._sections(sample_time)
        delay, q = np.exp(whole * q), np.exp(q)
        return np.asarray(delay * sum(np.polyval(b[::-1], q) / np.polyval(a[::-1], q) for b, a in sections))

    def largest_gain(self, sample_time: float, inverted: Dynamics | None) -> float:
        """Stability limit of the gain of integral action, per second, in a loop around the stage and the F of the
        inverted dynamics, if any: the gain at which the open loop has magnitude 1 at a phase of −180°; 2 ζ ω of a mode
        whose poles are lost in rounding."""
        if min(self.frequencies_Hz, default=math.inf) * sample_time < SLOWEST:
            return 4.0 * math.pi * self.frequencies_Hz[0] * self.damping[0]
        near, half = np.sinh(np.linspace(-7.0, 7.0, 4001)), 0.5 / sample_time
        around = [f * (1.0 + zeta * near) for f, zeta in zip(self.frequencies_Hz, self.damping, strict=True)]
        f = np.concatenate([np.geomspace(1e-7, 0.5, 20_000) / sample_time, *around])
        # The alias, for modes above half the sampling rate.
        f = np.unique(np.maximum(np.abs((f + half) % (2.0 * half) - half), 1e-9 * half))
        q = np.exp(-2j * np.pi * f * sample_time)
        loop = self.response(f, sample_time) * self._amplifier(f, sample_time) * sample_time * q / (1.0 - q)
        for D, R in inverted.pole_pairs(sample_time) if inverted else ():
            loop *= np.polyval(D[::-1], q) / np.polyval(R[::-1], q)
        # At crossings of the real axis, and at half the sampling rate.
        least = float(np.min(loop.real[np.append(loop.imag[:-1] * loop.imag[1:] <= 0.0, True)]))
        return -1.0 / least if least < 0.0 else math.inf

    def anticipated(self, y: ArrayLike, sample_time: float, *, amplifier: bool = False) -> Vector:
        """G⁻¹ y (N,) without lag, smoothed by a Gaussian with a bandwidth of twice the highest frequency, and
        optionally through the inverse of the amplifier; it anticipates y, which must be known in advance."""
        bandwidth_Hz = 2.0 * max(self.frequencies_Hz, default=0.05 / sample_time)

        def inverse(f: Vector, G: Vector) -> Vector:
            lag = self._amplifier(f, sample_time) if amplifier else 1.0
            return np.asarray(np.exp2(-0.5 * (f / bandwidth_Hz) ** 2) / (G * lag))

        return self._known(y, sample_time, inverse)

    def equalised(self, y: ArrayLike, sample_time: float) -> Vector:
        """G⁻¹ y (N,) without lag where G amplifies, and with the phase of G⁻¹ alone elsewhere, so that no noise is
        amplified."""
        return self._known(y, sample_time, lambda _, G: 1.0 / (G * np.maximum(1.0, 1.0 / np.abs(G))))

    def _amplifier(self, frequencies_Hz: Vector, sample_time: float) -> Vector:
        """Complex response of the amplifier at frequencies (k,)."""
        p = math.exp(-sample_time / self.amplifier_lag_s) if self.amplifier_lag_s else 0.0
        return np.asarray((1.0 - p) / (1.0 - p * np.exp(-2j * np.pi * frequencies_Hz * sample_time)))

    def _known(self, y: ArrayLike, sample_time: float, response: Callable[[Vector, Vector], Vector]) -> Vector:
        """A known signal y (N,) filtered by a response, which is a function of frequencies (k,) and of G there."""
        y = np.asarray(y, dtype=np.float64)
        margin = min(y.size - 1, MARGIN)
        mirrored = np.concatenate([2.0 * y[0] - y[margin:0:-1], y, 2.0 * y[-1] - y[-2 : -margin - 2 : -1]])
        f = np.fft.rfftfreq(mirrored.size, sample_time).astype(np.float64)
        spectrum = np.fft.rfft(mirrored) * response(f, self.response(f, sample_time))
        return np.asarray(np.fft.irfft(spectrum, mirrored.size)[margin : margin + y.size])

    def __str__(self) -> str:
        modes = " and ".join(
            f"{quantity(f, 'Hz', 4)} with damping {100.0 * zeta:.3g} %"
            for f, zeta in zip(self.frequencies_Hz, self.damping, strict=True)
        )
        words = {
            f"a resonance at {modes}": modes,
            f"a delay of {quantity(self.delay_s, 's', 3)}": True,
            f"an amplifier lag of {quantity(self.amplifier_lag_s, 's', 3)}": self.amplifier_lag_s,
        }
        return ", ".join(word for word, applies in words.items() if applies)

    def _sections(self, sample_time: float) -> tuple[float, list[tuple[Vector, Vector]]]:
        """Whole samples of the delay; numerator and denominator of each parallel section of the rest of G, the last one
        with the residual compliance."""
        whole, fraction = divmod(self.delay_s / sample_time, 1.0)
        sections: list[tuple[Vector, Vector]] = []
        for f, zeta, gain in zip(self.frequencies_Hz, self.damping, self.gains, strict=True):
            a = poles(f, zeta, sample_time)
            pulse = np.diff(_step_response(sample_time * (np.arange(4.0) - fraction), f, zeta))
            sections.append((gain * np.convolve(a, pulse)[:3], a))
        if (rest := 1.0 - sum(self.gains)) > 1e-12:
            b, a = sections.pop() if sections else (np.zeros(1), np.ones(1))
            direct = np.convolve([rest * (1.0 - fraction), rest * fraction], a)
            sections.append((np.polyadd(b[::-1], direct[::-1])[::-1].copy(), a))
        return whole, sections


def delayed(dynamics: Dynamics | None, delay_s: float) -> Dynamics | None:
    """Dynamics, or None, with a further delay."""
    g = dynamics or Dynamics((), (), (), 0.0)
    return replace(g, delay_s=g.delay_s + delay_s) if delay_s else dynamics


@dataclass(frozen=True)
class KnownDynamics:
    """What is known of a stage: the dynamics of its model, those that the model leaves out, and the sensor's delay."""

    dynamics: Dynamics | None
    left_out: Dynamics | None
    sensor_delay_s: Number


class Stream:
    """Parallel filters, each a numerator and a denominator with a_0 = 1, for chunks of a signal (N,) or of columns
    (N, k), in equilibrium before the first sample at a level, by default at that sample."""

    def __init__(self, sections: Sequence[tuple[Vector, Vector]], level: float | None) -> None:
        self._sections, self._level = sections, level
        self._states: list[Matrix] = []

    def __call__(self, v: Matrix) -> Matrix:
        """The next chunk of the output."""
        if not len(v):
            return v
        x = np.ascontiguousarray(v).reshape(len(v), -1)
        if not self._states:
            self._balance = x[0].copy() if self._level is None else np.full(x.shape[1], self._level)
            self._states = [np.zeros((1 + max(map(len, section)), x.shape[1])) for section in self._sections]
        y = np.tile(self._balance, (len(x), 1))
        for (b, a), state in zip(self._sections, self._states, strict=True):
            bindings.filter(b, a, state, self._balance, x, y)
        return y.reshape(v.shape)


def poles(f: float, zeta: float, sample_time: float) -> Vector:
    """Denominator (3,) of a mode."""
    w = 2.0 * math.pi * f * sample_time
    return np.array(
        [1.0, -2.0 * math.exp(-zeta * w) * math.cos(w * math.sqrt(1.0 - zeta**2)), math.exp(-2.0 * zeta * w)]
    )


def _step_response(t: Vector, f: float, zeta: float) -> Vector:
    """Response of a mode to a unit step, at times (k,); 0 before it."""
    w = 2.0 * math.pi * f
    damped, t = w * math.sqrt(1.0 - zeta**2), np.maximum(t, 0.0)
    oscillation = np.cos(damped * t) + zeta * w / damped * np.sin(damped * t)
    return np.asarray(1.0 - np.exp(-zeta * w * t) * oscillation)
