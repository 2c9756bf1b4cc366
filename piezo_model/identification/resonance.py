"""A scan for a mode in the averaged cross-spectra of a recording, in closed form for each frequency and damping.

With the spectra of the drive and of a few of its plays, X_i, the output is explained by

    Y = Σ_i (c_i + Σ_modes g (a_i + b_i z⁻¹)) X_i,    g = D(1) / D(z),

which is linear in a, b and c: two taps hold any delay within a sample. The squares are divided by the residual of the
static part, smoothed by its median over an octave, so that no band decides alone: a resonance is narrower than that.

Source: L. Ljung, System Identification, 2nd edition 1999, section 8.4, for spectral weighting; P. D. Welch, IEEE
Transactions on Audio and Electroacoustics 15 (1967) 70–73, for the averages.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from piezo_model.dynamics import HIGHEST, Dynamics
from piezo_model.identification.error_model import spans
from piezo_model.operators import play
from piezo_model.recordings import Recording
from solvers.arrays import Matrix, Vector

PLAYS = (0.1, 0.25, 0.45, 0.7)
"""Thresholds of the plays, as shares of half the drive's range."""
SEGMENT, SHORTEST = 8192, 1024
"""Samples of a segment, at most, and at least."""
FIRST_BIN, LAST = 16, 0.42
"""Bin of the lowest frequency of the scan, and the highest frequency used as a share of the sampling rate."""
RATIO, DAMPINGS = 1.012, (0.004, 0.015, 0.05, 0.3)
"""Smallest ratio of consecutive frequencies of the scan, which grows with the width of the mode, and its damping
ratios."""
DAMPING_ENDS, MARGIN = (1e-4, 0.9), 1.1
RIDGE, FLOOR = 1e-9, 1e-12
MEDIANS = 120
TAPS = 3
"""Those of the residual compliance, for a delay of up to two samples."""
Mode = tuple[float, float]
"""Frequency in Hz and damping ratio."""


@dataclass(frozen=True)
class Peak:
    """The mode that explains the most, and the share of the whitened squares that it saves."""

    frequency_Hz: float
    damping: float
    gain: float
    inside: bool
    """Whether it lies within the frequencies of the scan, and not at an end."""
    share: float
    """Of the static gain; the rest is residual compliance."""


class Spectra:
    """Cross-spectra of the drive, its plays and the output of a recording, whitened."""

    def __init__(self, recording: Recording) -> None:
        self.sample_time = recording.sample_time
        low, high = recording.x_range
        u = (2.0 * recording.x - low - high) / (high - low)
        z = play(u, np.array(PLAYS), np.full(len(PLAYS), u[0]))[0]
        columns = np.vstack([u, z.T, recording.y])
        size = _segment(recording)
        window, S = np.hanning(size), np.zeros((size // 2 + 1, len(columns), len(columns)), dtype=complex)
        for part in spans(recording):
            for i in range(part.start, part.stop - size + 1, size // 2):
                segment = columns[:, i : i + size]
                F = np.fft.rfft((segment - segment.mean(axis=1, keepdims=True)) * window, axis=1)
                S += np.einsum("if,jf->fij", F.conj(), F)
        f = np.fft.rfftfreq(size, self.sample_time)
        used = (f > 1.5 * f[1]) & (f < LAST / self.sample_time)
        self.f, self.lowest, S = f[used], FIRST_BIN * f[1], S[used]
        self._q = np.exp(-2j * np.pi * self.f * self.sample_time)
        p = len(columns) - 1
        residual = self._residual(S, p)
        whitening = _octave_median(self.f, residual)[:, None, None]
        S = S / whitening
        self._set(S, p)
        self._total = float(np.sum(S[:, p, p].real))

    @staticmethod
    def can_be_of(recording: Recording) -> bool:
        """Whether a recording is long enough."""
        return _segment(recording) >= SHORTEST

    def _set(self, S: Matrix, p: int) -> None:
        """Set the spectra of the p inputs with each other, real over imaginary part, and with the output."""
        inputs = S[:, :p, :p].reshape(-1, p * p)
        self._S, self._cross = np.vstack([inputs.real, -inputs.imag]), np.ascontiguousarray(S[:, :p, p])

    def _residual(self, S: Matrix, p: int) -> Vector:
        """Squares that the static part with two taps leaves at each frequency."""
        self._set(S, p)
        shapes = np.array([np.ones_like(self._q), self._q])
        c, _ = self._explained(shapes)
        left = np.vstack([-(c.reshape(2, p).T @ shapes), np.ones(self.f.size)])
        return np.asarray(np.maximum(np.einsum("if,fij,jf->f", left.conj(), S, left).real, 0.0))

    def _explained(self, shapes: Matrix) -> tuple[Vector, float]:
        """Coefficients of least squares of the shapes (m, F) times the p inputs, and the squares that they explain."""
        m, p = len(shapes), self._cross.shape[1]
        weights = (shapes.conj()[:, None] * shapes).reshape(m * m, -1)
        real = np.hstack([weights.real, weights.imag]) @ self._S  # half the work of the complex product
        P = real.reshape(m, m, p, p).transpose(0, 2, 1, 3).reshape(m * p, m * p)
        q = (shapes.conj() @ self._cross).real.reshape(m * p)
        scale = 1.0 / np.sqrt(np.diag(P) + 1e-300)
        c = scale * np.linalg.solve(P * np.outer(scale, scale) + RIDGE * np.eye(m * p), q * scale)
        return c, float(q @ c)

    def left(self, modes: Sequence[Mode]) -> float:
        """The whitened squares that modes leave."""
        return self._total - self._explained(self._shapes(modes))[1]

    def _share(self, modes: Sequence[Mode]) -> float:
        """The share of the last mode in the static gain."""
        shapes = self._shapes(modes)
        gains = self._explained(shapes)[0].reshape(len(shapes), -1).sum(axis=1)
        return float(gains[-2:].sum() / gains.sum())

    def _shapes(self, modes: Sequence[Mode]) -> Matrix:
        """Two taps behind each mode of unit static gain, after those of residual compliance."""
        shapes = [self._q**tap for tap in range(TAPS)]
        for f, zeta in modes:
            D = Dynamics((f,), (zeta,), (1.0,), 0.0).pole_pairs(self.sample_time)[0][0]
            g = 1.0 / (D[0] + D[1] * self._q + D[2] * self._q**2)
            shapes += [g, g * self._q]
        return np.array(shapes)

    def peak(self, known: Sequence[Mode] = ()) -> Peak:
        """The mode that explains the most beside the known ones."""
        ends = self.lowest, HIGHEST / self.sample_time
        tried = [
            (f, zeta)
            for zeta in (DAMPINGS[1:2] if known else DAMPINGS)
            for f in np.exp(np.arange(np.log(ends[0]), np.log(ends[1]), max(np.log(RATIO), zeta))).tolist()
        ]
        first = min((self.left([*known, mode]), *mode) for mode in tried)

        def mode(at: Vector) -> Mode:
            return float(np.clip(np.exp(at[0]), *ends)), float(np.clip(np.exp(at[1]), *DAMPING_ENDS))

        begin = np.log(first[1:])
        simplex = begin + np.array([[0.0, 0.0], [0.67 * np.log(RATIO), 0.0], [0.0, 0.5]])
        found = minimize(
            lambda at: self.left([*known, mode(at)]),
            begin,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 80},
        )
        (f, zeta), before = mode(found.x), self.left(known)
        gain = 1.0 - float(found.fun) / before if before > 0.0 else 0.0
        return Peak(f, zeta, gain, ends[0] * MARGIN < f < ends[1] / MARGIN, self._share([*known, (f, zeta)]))


def _segment(recording: Recording) -> int:
    """Samples of a segment, of which the longest part has four."""
    return min(SEGMENT, max(part.stop - part.start for part in spans(recording)) // 4)


def _octave_median(f: Vector, power: Vector) -> Vector:
    """The power (F,), smoothed by its median over an octave."""
    low, high = np.searchsorted(f, f / np.sqrt(2.0)), np.searchsorted(f, f * np.sqrt(2.0))
    at = np.unique(np.round(np.geomspace(1, f.size, MEDIANS)).astype(int)) - 1
    medians = np.array([np.median(power[low[i] : max(high[i], low[i] + 5)]) for i in at])
    return np.asarray(np.exp(np.interp(np.log(f), np.log(f[at]), np.log(medians + FLOOR * power.max() + 1e-300))))
