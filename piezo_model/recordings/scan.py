"""The samples of a file in one pass and in bounded memory: checked, and held, streamed again or interpolated.

Samples at uneven times are brought to an even clock by linear interpolation,

    y(t_0 + k T) = y_i + (y_{i+1} − y_i) (t_0 + k T − t_i) / (t_{i+1} − t_i),   t_i ≤ t_0 + k T ≤ t_{i+1}.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from piezo_model.recordings.chunks import ABSURD, RecordingError, limited, rechunk
from piezo_model.recordings.roles import Roles, seconds_per_unit
from piezo_model.recordings.sampling import CHUNK, ClockCheck, Where
from piezo_model.recordings.tables import ReadOptions, Table
from piezo_model.units import quantity
from solvers.arrays import Matrix, Vector

CLOCK_TOLERANCE = 0.01
"""Share of its duration by which a recording may last longer or shorter by its time column than by a given sampling
period."""
MOST_SAMPLES = 1_000_000_000


class ValueCheck:
    """Finite values and their range, over any number of pieces.

    The sentence of an error starts with the label; ``where`` names a row counted from 0.
    """

    def __init__(self, label: str, where: Where) -> None:
        """Start before the first sample."""
        self.label, self.where = label, where
        self.count = self.bad = 0
        self.low, self.high = math.inf, -math.inf
        self._first_bad, self._first_value, self._only_missing = 0, 0.0, True

    def update(self, values: Vector) -> None:
        """Take the next piece."""
        finite = np.abs(values) < ABSURD
        if not finite.all():
            if not self.bad:
                at = int(np.argmin(finite))
                self._first_bad, self._first_value = self.count + at, float(values[at])
            self.bad += int(values.size - np.count_nonzero(finite))
            self._only_missing &= bool(np.isnan(values[~finite]).all())
        self.count += values.size
        self.low = float(np.min(values, where=finite, initial=self.low))
        self.high = float(np.max(values, where=finite, initial=self.high))

    def finish(self) -> int:
        """Refuse what is not finite; returns the rows up to the last value where all the missing ones come at the
        end."""
        if not self.bad:
            return self.count
        if self._only_missing and self.bad == self.count - self._first_bad and self._first_bad >= 2:
            return self._first_bad
        value = self._first_value
        kind = "missing (or NaN)" if math.isnan(value) else "infinite" if math.isinf(value) else f"{value:g}"
        absurd = ", which is too large for a measured value" if math.isfinite(value) else ""
        many = f"; in all {self.bad} of {self.count} values are missing, infinite or absurd" if self.bad > 1 else ""
        raise RecordingError(f"{self.label} is {kind} in {self.where(self._first_bad)}{absurd}{many}")


@dataclass(frozen=True)
class Scan:
    """What one pass over a table found, and how to stream the signals."""

    sample_time: float
    """Sampling period in seconds."""
    time_resolution: float
    """Rounding that shows in the times, in seconds."""
    length: int
    ranges: tuple[tuple[float, float], ...]
    """Smallest and largest value of every signal."""
    signals: Callable[[], Iterable[Matrix]]
    remark: str = ""
    """What was left out or interpolated, as a clause that begins with a comma."""


def scan(
    table: Table, roles: Roles, reading: ReadOptions, tolerance: float, hold: int = 0, length: int | None = None
) -> Scan:
    """Check a time column and signal columns in one pass.

    Parameters
    ----------
    table : Table
        Opened table.
    roles : Roles
        Its columns.
    reading : ReadOptions
        What the user says of them.
    tolerance : float
        Allowed deviation of an interval, as a share of the sampling period.
    hold : int
        Rows up to which the signals are kept in memory and not read again.
    length : int, optional
        Rows to look at.

    Raises
    ------
    RecordingError
        Missing, NaN or infinite values but for missing ones in the last rows, times that run backwards, stand still,
        leap or jitter, fewer than two rows, or a time column that contradicts the sampling period given.
    """
    if not 0 < tolerance < 0.5:
        raise RecordingError(f"the time tolerance is a share of the sampling period between 0 and 0.5, not {tolerance}")
    at, time = list(roles.at.values()), roles.at.get("time")
    signals = at[time is not None :]
    if time is not None:
        unit = seconds_per_unit(table, table.columns[time])
        label = f"{table.path}: time column {table.columns[time].name!r}"
        clock = ClockCheck(label, table.where, unit, tolerance, even=reading.resample is None)
    elif reading.resample is not None:
        raise RecordingError(f"{table.path}: --resample needs a time column, and there is none; name it with --time")
    else:
        clock, unit = None, reading.sample_time or table.columns[signals[0]].sample_time or 1.0
    values = [ValueCheck(f"{table.path}: column {table.columns[k].name!r}", table.where) for k in at]
    other = [] if roles.unread is None else [roles.unread]
    hold = 0 if (table.columns[signals[0]].rows or 0) > hold else hold  # nothing is held that will be dropped
    first, last, held = np.inf, -np.inf, list[Matrix]()
    for piece in rechunk(limited(table.pieces([*at, *other]), length), CHUNK):
        for check, column in zip(values, piece[: len(at)], strict=True):
            check.update(column)
        if clock and not any(check.bad for check in values):
            clock.update(piece[0])
        for column in piece[len(at) :]:
            first, last = np.fmin.reduce(column, initial=first), np.fmax.reduce(column, initial=last)
        held = [*held, piece[time is not None : len(at)]] if values[0].count <= hold else []
    complete, rows = min(check.finish() for check in values), values[0].count
    if complete < rows:
        found, left = scan(table, roles, reading, tolerance, hold, complete), rows - complete
        left_out = "row is incomplete and was" if left == 1 else f"{left} rows are incomplete and were"
        return replace(found, remark=f", the last {left_out} left out{found.remark}")
    if clock is None and rows < 2:
        raise RecordingError(f"{table.path}: has {rows} data row{'' if rows == 1 else 's'}, and a recording needs two")
    for k in other:
        _refuse_other_clock(table, k, last - first, (rows - 1) * unit, unit)
    found = Scan(
        clock.sample_time() if clock else unit,
        clock.resolution * unit if clock else 0.0,
        rows,
        tuple((check.low, check.high) for check in values[len(at) - len(signals) :]),
        partial(iter, (np.concatenate(held, axis=1),)) if held else partial(_streamed, table, signals, rows),
    )
    if reading.resample is None or clock is None:
        return found
    length = int(clock.duration_s / reading.resample + 1e-9) + 1
    if not 2 <= length <= MOST_SAMPLES:
        raise RecordingError(
            f"{table.path}: --resample {reading.resample:g} gives {length} samples of {clock.duration_s:g} s; take "
            "another period"
        )
    return replace(
        found,
        sample_time=reading.resample,
        time_resolution=0.0,
        length=length,
        signals=partial(_streamed, table, at, rows, reading.resample / unit),
        remark=f", interpolated from {rows} rows at the times of the file",
    )


def _refuse_other_clock(table: Table, time: int, by_clock: float, by_option: float, period: float) -> None:
    """Refuse a sampling period that a time column contradicts."""
    column = table.columns[time]
    by_clock *= seconds_per_unit(table, column)
    # one that stands still is not believed
    if by_clock > 0.0 and abs(by_clock - by_option) > CLOCK_TOLERANCE * by_clock:
        raise RecordingError(
            f"{table.path}: lasts {quantity(by_clock, 's')} by its time column {column.name!r} and "
            f"{quantity(by_option, 's')} by "
            f"--sample-time {period:g}; leave out --sample-time, or give --resample where "
            "the times are uneven, or --time none where that column is not a clock"
        )


def _streamed(table: Table, at: Sequence[int], length: int, period: float | None = None) -> Iterator[Matrix]:
    rows = limited(table.pieces(at), length)
    return rows if period is None else resampled(rechunk(rows, CHUNK), period)


def resampled(pieces: Iterable[Matrix], period: float) -> Iterator[Matrix]:
    """Signals (signals, samples) every ``period`` from pieces of times and signals, shape (1 + signals, rows); times
    never fall, and the last row of a piece is kept until the next piece comes."""
    held: Matrix | None = None
    first, done = 0.0, 0
    for piece in pieces:
        first = first if held is not None else float(piece[0, 0])
        window = piece if held is None else np.concatenate([held, piece], axis=1)
        stop = int((window[0, -1] - first) / period + 1e-9) + 1
        at = first + period * np.arange(done, stop)
        yield np.stack([np.interp(at, window[0], signal) for signal in window[1:]])
        held, done = piece[:, -1:].copy(), stop
