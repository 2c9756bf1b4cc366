"""A scan for a mode in the averaged cross-spectra of a recording, in closed form for each frequency and damping.

With the spectra X_i of the drive and of a few of its plays, the model of the output is

    Y = Σ_i (c_i + Σ_modes g (a_i + b_i z⁻¹)) X_i,    g = D(1) / D(z),

which is linear in a, b and c; two taps represent any delay up to one sample. The squares are whitened by the residual
of the static part, smoothed by a running median over an octave, so that no band dominates; a resonance is narrower.

Source: L. Ljung, System Identification, 2nd edition 1999, section 8.4, for spectral weighting; P. D. Welch, IEEE
Transactions on Audio and Electroacoustics 15 (1967) 70–73, for the averages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from piezo_model.dynamics import HIGHEST, Dynamics, poles
from piezo_model.operators import play
from piezo_model.recordings import Recording
from solvers.arrays import Matrix, Vector

PLAYS = (0.1, 0.25, 0.45, 0.7)
"""Thresholds of the plays, as shares of half the drive's range."""
SEGMENT, SHORTEST_SEGMENT = 8192, 64
"""Largest and smallest number of samples of a segment."""
FIRST, FIRST_BINS, LAST = 1.0 / 64.0, (6, 16), 0.42
"""Lowest frequency of the scan relative to the sampling rate, and the bins within which it is; highest one used."""
RATIO, DAMPINGS = 1.012, (0.004, 0.015, 0.05, 0.3)
"""Smallest ratio of consecutive frequencies of the scan (it grows with the width of the mode); damping ratios."""
DAMPING_ENDS, MARGIN, RIDGE, FLOOR = (1e-4, 0.9), 1.1, 1e-9, 1e-12
SIMPLEX = np.array([[0.0, 0.0], [0.67 * np.log(RATIO), 0.0], [0.0, 0.5]])
"""Corners of the first simplex relative to the best point of the scan, in the logarithms of frequency and damping."""
MEDIANS, BATCH, TAPS = 120, 16, 3
"""Medians of a spectrum; modes tried at once, whose responses fit into the cache; taps of the residual compliance, for
a delay of up to two samples."""
GAIN, CHANCE_GAIN, LEAST_DAMPED, MOST_DAMPED = 0.02, 36.0, 1e-3, 0.9
"""Smallest fraction of the whitened squares that a mode has to explain, and the same in samples: its twelve unknowns
explain twelve samples of noise, and the best of a scan three times as many; bounds of a damping ratio."""
APART, LIGHTLY_DAMPED = 0.1, 0.25
"""Smallest difference of the logarithms of two frequencies; largest damping ratio of a further mode, and of one above
all frequencies at which the output follows the drive, since residual hysteresis looks like a mode with more."""


@dataclass(frozen=True)
class Peak:
    """The mode that explains the largest share of the whitened squares, and that share (``gain``)."""

    frequency_Hz: float
    damping: float
    gain: float
    share: float
    """Its share of the static gain; the rest is residual compliance."""
    is_plausible: bool
    """True if the peak may be a mode: it gains enough, and is at no end of the scan."""


class Spectra:
    """Cross-spectra of the drive, its plays and the output of a recording, whitened."""

    def __init__(self, recording: Recording) -> None:
        self.sample_time, self.samples = recording.sample_time, recording.length
        low, high = recording.x_range
        u = (2.0 * recording.x - low - high) / (high - low)
        columns = np.vstack([u, play(u, np.array(PLAYS), np.full(len(PLAYS), u[0]))[0].T, recording.y])
        size = segment_of(recording)
        window, S = np.hanning(size), np.zeros((size // 2 + 1, len(columns), len(columns)), dtype=complex)
        for part in recording.parts:
            for i in range(part.start, part.stop - size + 1, size // 2):
                segment = columns[:, i : i + size]
                F = np.fft.rfft((segment - segment.mean(axis=1, keepdims=True)) * window, axis=1)
                S += np.einsum("if,jf->fij", F.conj(), F)
        f = np.fft.rfftfreq(size, self.sample_time)
        used = (f > 1.5 * f[1]) & (f < LAST / self.sample_time)
        lowest_Hz = np.clip(FIRST / self.sample_time, *(f[i] for i in FIRST_BINS))
        self.f, self.ends, S = f[used], (float(lowest_Hz), HIGHEST / self.sample_time), S[used]
        self._powers = np.exp(-2j * np.pi * self.sample_time * np.arange(1 - TAPS, TAPS)[:, None] * self.f)
        self._set(S)
        self._set(S / _octave_median(self.f, self._left_by_static(S))[:, None, None])

    def _set(self, S: Matrix) -> None:
        """Set the squares of the output, the cross-spectra of inputs and output, and those of the inputs, with the real
        parts above the imaginary parts."""
        inputs = S[:, :-1, :-1].reshape(self.f.size, -1)
        self.squares, self.cross = float(np.sum(S[:, -1, -1].real)), np.ascontiguousarray(S[:, :-1, -1])
        self._S = np.vstack([inputs.real, -inputs.imag])

    def _left_by_static(self, S: Matrix) -> Vector:
        """Residual squares of the static part with two taps, at each frequency."""
        static = Equations(self).with_response(np.ones(self.f.size), 2)
        left = np.vstack([-(static.coefficients().T @ self.powers(2)), np.ones(self.f.size)])
        return np.asarray(np.maximum(np.einsum("if,fij,jf->f", left.conj(), S, left).real, 0.0))

    def powers(self, stop: int, start: int = 0) -> Matrix:
        """z⁻ᵏ for k from ``start``, shape (stop − start, F)."""
        return self._powers[TAPS - 1 + start : TAPS - 1 + stop]

    def products(self, g: Matrix, m: int, h: Matrix, n: int) -> Matrix:
        """Real products (…, m p, n p) of the p inputs behind each of m taps of g (…, F) and of n taps of h (…, F)."""
        p, weights = self.cross.shape[1], (g.conj() * h)[..., None, :] * self.powers(n, 1 - m)
        flat = weights.reshape(-1, self.f.size)  # one product for all systems is faster than one for each
        sums = (np.hstack([flat.real, flat.imag]) @ self._S).reshape(*weights.shape[:-1], p, p)
        blocks = sums[..., m - 1 + np.arange(n) - np.arange(m)[:, None], :, :]
        return blocks.swapaxes(-3, -2).reshape(*h.shape[:-1], m * p, n * p)

    def peak(self, known: Sequence[tuple[float, float]] = ()) -> Peak:
        """The mode that explains the most in addition to the known ones, each a frequency in Hz and a damping ratio."""
        residual_compliance, ends = Equations(self).with_response(np.ones(self.f.size), TAPS), self.ends
        others = reduce(Equations.with_mode, known, residual_compliance)
        tried = np.array(
            [
                (f, zeta)
                for zeta in (DAMPINGS[1:2] if known else DAMPINGS)
                for f in np.exp(np.arange(math.log(ends[0]), math.log(ends[1]), max(math.log(RATIO), zeta)))
            ]
        )
        explained = [others.with_mode(tried[i : i + BATCH]).explained() for i in range(0, len(tried), BATCH)]
        begin = np.log(tried[np.argmax(np.concatenate(explained))])

        def mode(at: Vector) -> Vector:
            return np.asarray(np.exp(np.clip(at, *np.log([ends, DAMPING_ENDS]).T)))

        result = minimize(
            lambda at: -others.with_mode(mode(at)).explained(),
            begin,
            method="Nelder-Mead",
            options={"initial_simplex": begin + SIMPLEX, "maxfev": 80},
        )
        best, before = others.with_mode(mode(result.x)), self.squares - others.explained()
        gain = 1.0 - (self.squares - best.explained()) / before if before > 0.0 else 0.0
        gains, (f, zeta) = best.coefficients().sum(axis=-1), mode(result.x).tolist()
        inside = ends[0] * MARGIN < f < ends[1] / MARGIN and LEAST_DAMPED < zeta < MOST_DAMPED
        plausible = bool(inside and gain > max(GAIN, CHANCE_GAIN / self.samples))
        return Peak(f, zeta, float(gain), float(gains[-2:].sum() / gains.sum()), plausible)

    def beside(self, g: Dynamics) -> Peak | None:
        """A plausible mode in addition to those of G; None without one."""
        peak = self.peak([*zip(g.frequencies_Hz, g.damping, strict=True)])
        apart = all(abs(math.log(peak.frequency_Hz / f)) > APART for f in g.frequencies_Hz)
        return peak if apart and peak.damping < LIGHTLY_DAMPED and peak.is_plausible else None


@dataclass(frozen=True)
class Equations:
    """Normal equations P c = q of the least-squares fit of the output by the inputs, filtered by a few responses with
    taps; or those of many such systems at once."""

    spectra: Spectra
    responses: tuple[tuple[Matrix, int], ...] = ()
    P: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    q: Matrix = field(default_factory=lambda: np.zeros(0))

    def with_response(self, g: Matrix, taps: int) -> Equations:
        """The equations with one more response, or with one of many (…, F) in each system."""
        spectra, size, systems = self.spectra, len(self.q), g.shape[:-1]
        responses = *self.responses, (g, taps)
        column = np.concatenate([spectra.products(*response, g, taps) for response in responses], axis=-2)
        P = np.empty((*systems, column.shape[-2], column.shape[-2]))
        P[..., :size, :size], P[..., :, size:] = self.P, column
        P[..., size:, :size] = column[..., :size, :].swapaxes(-2, -1)
        q = np.empty(P.shape[:-1])
        q[..., :size] = self.q
        q[..., size:] = ((g[..., None, :] * spectra.powers(taps)).conj() @ spectra.cross).real.reshape(*systems, -1)
        return Equations(spectra, responses, P, q)

    def with_mode(self, modes: ArrayLike) -> Equations:
        """The equations with two taps of a mode of unit static gain, or of one of many modes (…, 2) in each system."""
        D = np.apply_along_axis(lambda mode: poles(mode[0], mode[1], self.spectra.sample_time), -1, modes)
        return self.with_response(D.sum(axis=-1, keepdims=True) / (D @ self.spectra.powers(3)), 2)

    def coefficients(self) -> Matrix:
        """Coefficients of each tap and input (…, m, p)."""
        scale = 1.0 / np.sqrt(np.diagonal(self.P, axis1=-2, axis2=-1) + 1e-300)
        scaled = self.P * scale[..., None] * scale[..., None, :] + RIDGE * np.eye(self.q.shape[-1])
        c = scale * np.linalg.solve(scaled, (self.q * scale)[..., None])[..., 0]
        return c.reshape(*c.shape[:-1], -1, self.spectra.cross.shape[1])

    def explained(self) -> Matrix:
        """The squares that the solution explains."""
        return np.sum(self.q * self.coefficients().reshape(self.q.shape), axis=-1)


def segment_of(recording: Recording) -> int:
    """Samples of a segment: at most a quarter of the longest part."""
    return min(SEGMENT, max(part.stop - part.start for part in recording.parts) // 4)


def _octave_median(f: Vector, power: Vector) -> Vector:
    """The power (F,), smoothed by a running median over an octave."""
    low, high = np.searchsorted(f, f / np.sqrt(2.0)), np.searchsorted(f, f * np.sqrt(2.0))
    at = np.unique(np.round(np.geomspace(1, f.size, MEDIANS)).astype(int)) - 1
    medians = np.array([np.median(power[low[i] : max(high[i], low[i] + 5)]) for i in at])
    return np.asarray(np.exp(np.interp(np.log(f), np.log(f[at]), np.log(medians + FLOOR * power.max() + 1e-300))))
