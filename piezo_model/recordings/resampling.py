"""Samples at uneven times brought to an even clock by linear interpolation.

    y(t_0 + k T) = y_i + (y_{i+1} − y_i) (t_0 + k T − t_i) / (t_{i+1} − t_i),   t_i ≤ t_0 + k T ≤ t_{i+1}

in one pass and bounded memory: the last row of a piece is kept until the next piece comes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from piezo_model.recordings.pieces import RecordingError, check_sample_time
from solvers.arrays import Matrix

MOST_SAMPLES = 1_000_000_000


def resampled_length(label: str, duration_s: float, period_s: float) -> int:
    """Samples from the first time to the last; RecordingError where the period is none for this recording."""
    check_sample_time(f"{label}: --resample: ", period_s)
    length = int(duration_s / period_s + 1e-9) + 1
    if not 2 <= length <= MOST_SAMPLES:
        raise RecordingError(
            f"{label}: --resample {period_s:g} gives {length} samples of {duration_s:g} s; take another period"
        )
    return length


def resampled(pieces: Iterable[Matrix], period: float) -> Iterator[Matrix]:
    """Signals (signals, samples) every ``period`` from pieces of times and signals, shape (1 + signals, rows); times
    never fall."""
    held: Matrix | None = None
    first, done = 0.0, 0
    for piece in pieces:
        if not piece.shape[1]:
            continue
        first = first if held is not None else float(piece[0, 0])
        window = piece if held is None else np.concatenate([held, piece], axis=1)
        stop = int((window[0, -1] - first) / period + 1e-9) + 1
        at = first + period * np.arange(done, stop)
        yield np.stack([np.interp(at, window[0], signal) for signal in window[1:]])
        held, done = piece[:, -1:].copy(), stop
