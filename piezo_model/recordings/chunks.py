"""Pieces of a table: float64 arrays of shape (columns, rows), cut to any size while they stream by."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.structure import SAMPLE_TIMES
from solvers.arrays import Matrix, Vector

BUFFER_BYTES = 1 << 18
"""Bytes of a file that are read at once; Arrow reads some tens of such blocks ahead."""
ABSURD = 1e30
"""Size from which a value is none: instruments write 9.9e37 for an overload."""


class RecordingError(ValueError):
    """A recording cannot be read or written; the message is one sentence that names file, column and row."""


def check_sample_time(label: str, seconds: float) -> None:
    """Refuse a sampling period that no structure can have."""
    least, most = SAMPLE_TIMES
    if not least <= seconds <= most:
        raise RecordingError(f"{label}the sampling period must be from {least:g} to {most:g} s, not {seconds}")


def rechunk(pieces: Iterable[Matrix], size: int) -> Iterator[Matrix]:
    """Cut pieces of any number of rows into pieces of exactly ``size`` rows, the last one shorter; all are copies.

    >>> [piece.shape for piece in rechunk([np.zeros((2, 5)), np.zeros((2, 4))], 4)]
    [(2, 4), (2, 4), (2, 1)]
    """
    if size < 1:
        raise ValueError(f"the size of a chunk must be at least 1, not {size}")
    held: list[Matrix] = []
    missing = size
    for piece in pieces:
        while piece.shape[1] >= missing:
            yield np.concatenate([*held, piece[:, :missing]], axis=1)
            piece, held, missing = piece[:, missing:], [], size
        if piece.shape[1]:
            held.append(piece)
            missing -= piece.shape[1]
    if held:
        yield np.concatenate(held, axis=1)


class Elapsed:
    """Seconds since the first time of a column, over any number of pieces, exact to the unit that the times are kept
    in.

    As a number since 1970 a time would be rounded to 0.2 µs. Times of day may pass midnight.
    """

    def __init__(self) -> None:
        """Start before the first time."""
        self._ends: tuple[Any, Any] | None = None
        """First and last time so far."""
        self._midnights = 0

    def seconds(self, times: NDArray[Any]) -> Vector:
        """Seconds of the next piece of datetime64, or of timedelta64 since midnight; NaN where one is missing."""
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


def limited(pieces: Iterable[Matrix], rows: int | None) -> Iterator[Matrix]:
    """The first rows of pieces, or all of them."""
    for piece in pieces:
        if rows is None:
            yield piece
        elif rows > 0:
            yield piece[:, :rows]
            rows -= piece.shape[1]


def first_line(error: Exception) -> str:
    """What another library has to say, as a clause of a sentence."""
    return str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
