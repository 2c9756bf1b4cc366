"""Where the drive of a recording moves, what it has covered by then, how much of the recording its start is found from,
and which first samples no start of the operators explains, as where an amplifier was switched on."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

HEAD, LONGEST_HEAD = 200_000, 500_000
"""Samples that the start is found from: the first, or twice as many as it takes for the plays to forget it."""
MOVED = 0.01
"""Share of its range that a drive covers within the noise of its rest."""
TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""An error at the start is a transient's beyond so many times the largest later one, and beyond this share of the
range."""


def head_of(recording: Recording, s: ModelStructure) -> Recording:
    """The samples that starts are tried on."""
    settled = settled_from(recording, s)
    return recording.head(max(HEAD, min(2 * settled, max(LONGEST_HEAD, settled + HEAD // 2))))


def settled_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves at all is known, whatever it started at."""
    span = recording.x_range[1] - recording.x_range[0]
    return covered_from(
        recording, max((2.0 * r * s.x_scale for r in s.play_thresholds if 2.0 * r * s.x_scale < span), default=0.0)
    )


def moving_from(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays so."""
    return covered_from(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def covered_from(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    low, high, seen = math.inf, -math.inf, 0
    for x, _ in recording.chunks():
        after = max(skip - seen, 0)
        lows, highs = (
            np.minimum.accumulate(np.minimum(x[after:], low)),
            np.maximum.accumulate(np.maximum(x[after:], high)),
        )
        covered = np.flatnonzero(highs - lows >= span)
        if covered.size:
            return seen + after + int(covered[0])
        low, high, seen = np.min(lows, initial=low), np.max(highs, initial=high), seen + x.size
    return seen


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    if skip == 0:
        return recording.y_range
    low, high = math.inf, -math.inf
    for _, y, head in skipping(recording, skip):
        low, high = float(np.min(y[head:], initial=low)), float(np.max(y[head:], initial=high))
    return low, high


def skipping(recording: Recording, skip: int) -> Iterator[tuple[Vector, Vector, int]]:
    """Chunks of a recording, each with how many of its samples are among the first ``skip``."""
    for x, y in recording.chunks():
        yield x, y, min(skip, x.size)
        skip -= min(skip, x.size)


def longest_transient(head: Recording, s: ModelStructure) -> int:
    """Samples at the start within which a transient may lie; 0 where the drive does not move after them."""
    look = min(settled_from(head, s), int(TRANSIENT_SHARE * head.length))
    return look if look and moving_from(head, look) < head.length else 0


def transient_end(error: Vector, look: int) -> int:
    """First samples, at most ``look``, of which an error, as a share of the range, is far larger than anywhere after
    them; 0 for none."""
    later = float(np.max(error[look:]))
    if np.max(error[:look], initial=0.0) <= max(FAR_MORE * later, NOTABLE):
        return 0
    return int(np.flatnonzero(error[:look] > later)[-1]) + 1
