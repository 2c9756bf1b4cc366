"""Chunks of a table: float64 arrays of shape (columns, rows), cut to any size while they are streamed."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.structure import SAMPLE_TIMES
from solvers.arrays import Matrix, Vector

BUFFER_BYTES = 1 << 18
"""Bytes of a file in one read; Arrow reads some tens of such blocks ahead."""
ABSURD = 1e30
"""Smallest magnitude that is not a measured value: instruments write 9.9e37 for an overload."""


class RecordingError(ValueError):
    """A recording cannot be read or written; the message is one sentence that names file, column and row."""


def check_sample_time(label: str, seconds: float) -> None:
    """Refuse a sampling period that no structure can have."""
    least, most = SAMPLE_TIMES
    if not least <= seconds <= most:
        raise RecordingError(f"{label}the sampling period must be from {least:g} to {most:g} s, not {seconds}")


def rechunk(chunks: Iterable[Matrix], size: int) -> Iterator[Matrix]:
    """Cut chunks of any size into copies of exactly ``size`` rows; the last one may be shorter.

    >>> [chunk.shape for chunk in rechunk([np.zeros((2, 5)), np.zeros((2, 4))], 4)]
    [(2, 4), (2, 4), (2, 1)]
    """
    if size < 1:
        raise ValueError(f"the size of a chunk must be at least 1, not {size}")
    held: list[Matrix] = []
    missing = size
    for chunk in chunks:
        while chunk.shape[1] >= missing:
            yield np.concatenate([*held, chunk[:, :missing]], axis=1)
            chunk, held, missing = chunk[:, missing:], [], size
        if chunk.shape[1]:
            held.append(chunk)
            missing -= chunk.shape[1]
    if held:
        yield np.concatenate(held, axis=1)


def limited(chunks: Iterable[Matrix], rows: int) -> Iterator[Matrix]:
    """The first rows of a stream of chunks."""
    for chunk in chunks:
        yield chunk[:, :rows]
        rows = max(rows - chunk.shape[1], 0)


class Elapsed:
    """Converts chunks of a time column to seconds since its first time, exact to the unit of the times.

    Seconds since 1970 in double precision would be rounded to 0.2 µs. Times of day may pass midnight.
    """

    def __init__(self) -> None:
        self._ends: tuple[Any, Any] | None = None
        """First and last time so far."""
        self._midnights = 0

    def seconds(self, times: NDArray[Any]) -> Vector:
        """Seconds of the next chunk of datetime64, or of timedelta64 since midnight; NaN for a missing one."""
        result, known = np.full(times.shape, np.nan), ~np.isnat(times)
        kept = times[known]
        if kept.size:
            first, last = self._ends or (kept[0], kept[0])
            self._ends = first, kept[-1]
            if kept.dtype.kind == "m":
                midnights = self._midnights + np.cumsum(np.diff(kept, prepend=last) < np.timedelta64(-12, "h"))
                self._midnights, kept = int(midnights[-1]), kept + midnights * np.timedelta64(1, "D")
            result[known] = (kept - first) / np.timedelta64(1, "s")
        return result


def first_line(error: Exception) -> str:
    """First line of an error's message, or its type."""
    return str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
