"""The samples of a file in one pass and in bounded memory: checked, then held, streamed again or interpolated.

Samples at uneven times are resampled to an even clock by linear interpolation,

    y(t_0 + k T) = y_i + (y_{i+1} − y_i) (t_0 + k T − t_i) / (t_{i+1} − t_i),   t_i ≤ t_0 + k T ≤ t_{i+1}.
"""

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from piezo_model.recordings.chunks import ABSURD, RecordingError, limited, rechunk
from piezo_model.recordings.roles import Roles, seconds_per_unit
from piezo_model.recordings.sampling import CHUNK, ClockCheck, RowName
from piezo_model.recordings.tables import ReadOptions, Table
from piezo_model.units import quantity
from solvers.arrays import Matrix, Vector

CLOCK_TOLERANCE = 0.01
"""Largest relative difference between the duration by a time column and by a given sampling period."""
MOST_SAMPLES = 1_000_000_000


class ValueCheck:
    """Checks that values are finite and finds their range, over any number of chunks.

    Error messages start with the label; ``where`` names a row counted from 0. With ``gaps`` up to half of the values
    may be missing.
    """

    def __init__(self, label: str, where: RowName, gaps: bool = False) -> None:
        self.label, self.where, self.gaps = label, where, gaps
        self.count = self.bad = self.end = 0
        self.low, self.high = math.inf, -math.inf
        self._first_bad, self._first_value, self._only_missing = 0, 0.0, True

    def update(self, values: Vector) -> None:
        """Check the next chunk."""
        finite = np.abs(values) < ABSURD
        if not finite.all():
            if not self.bad:
                at = int(np.argmin(finite))
                self._first_bad, self._first_value = self.count + at, float(values[at])
            self.bad += int(values.size - np.count_nonzero(finite))
            self._only_missing &= bool(np.isnan(values[~finite]).all())
        if finite.any():
            self.end = self.count + values.size - int(np.argmax(finite[::-1]))
        self.count += values.size
        self.low = float(np.min(values, where=finite, initial=self.low))
        self.high = float(np.max(values, where=finite, initial=self.high))

    def finish(self, shorten: bool = True) -> int:
        """The number of complete rows, with ``shorten`` up to the last value that is not missing. RecordingError for
        bad values."""
        inside = self.bad - (self.count - self.end) * shorten
        if not self.bad or (self._only_missing and self.end >= 2 and 2 * inside <= self.end * self.gaps):
            return self.end
        value = self._first_value
        kind = "missing (or NaN)" if math.isnan(value) else "infinite" if math.isinf(value) else f"{value:g}"
        absurd = ", which is too large for a measured value" if math.isfinite(value) else ""
        many = f"; in all {self.bad} of {self.count} values are missing, infinite or absurd" if self.bad > 1 else ""
        raise RecordingError(f"{self.label} is {kind} in {self.where(self._first_bad)}{absurd}{many}")


@dataclass(frozen=True)
class Scan:
    """Results of one pass over a table, and a stream of the signals."""

    sample_time: float
    """Sampling period in seconds."""
    time_resolution: float
    """Visible rounding of the times, in seconds."""
    length: int
    ranges: tuple[tuple[float, float], ...]
    """Smallest and largest value of every signal."""
    signals: Callable[[], Iterable[Matrix]]
    missing: int = 0
    """Rows without an output."""
    remark: str = ""
    """Rows left out or interpolated, as a clause that begins with a comma."""


def scan(
    table: Table, roles: Roles, options: ReadOptions, tolerance: float, hold: int = 0, length: int = sys.maxsize
) -> Scan:
    """Check a time column and signal columns in one pass.

    Parameters
    ----------
    table : Table
        Opened table.
    roles : Roles
        Its columns.
    options : ReadOptions
        Properties of the file that the user gives.
    tolerance : float
        Allowed deviation of an interval, as a share of the sampling period.
    hold : int
        Largest number of rows that are kept in memory; a longer table is read again at every use.
    length : int
        Largest number of rows to read.

    Raises
    ------
    RecordingError
        Missing, NaN or infinite values, except up to half of the outputs and missing ones in the last rows; times that
        run backwards, stand still, leap or jitter; fewer than two rows; or a time column that contradicts the given
        sampling period.
    """
    if not 0 < tolerance < 0.5:
        raise RecordingError(f"the time tolerance is a share of the sampling period between 0 and 0.5, not {tolerance}")
    at, time = list(roles.at.values()), roles.at.get("time")
    signals = at[time is not None :]
    if time is not None:
        unit = seconds_per_unit(table, table.columns[time])
        label = f"{table.path}: time column {table.columns[time].name!r}"
        clock = ClockCheck(label, table.where, unit, tolerance, even=options.resample is None)
    elif options.resample is not None:
        raise RecordingError(f"{table.path}: --resample needs a time column, and there is none; name it with --time")
    else:
        clock, unit = None, options.sample_time or table.columns[signals[0]].sample_time or 1.0
    values = [
        ValueCheck(f"{table.path}: column {table.columns[k].name!r}", table.where, gaps=role == "output")
        for role, k in roles.at.items()
    ]
    unread = [] if roles.unread is None else [roles.unread]
    hold = 0 if (table.columns[signals[0]].rows or 0) > hold else hold  # a longer table is not held at all
    first, last, held, times = np.inf, -np.inf, list[Matrix](), np.empty(0)
    for chunk in rechunk(limited(table.chunks([*at, *unread]), length), CHUNK):
        for check, column in zip(values, chunk, strict=False):
            check.update(column)
        if clock and not any(check.bad for check in values if not check.gaps):
            times = np.concatenate([times, chunk[0]])  # those after the last output may be no samples
            sampled, times = np.split(times, [times.size - values[-1].count + values[-1].end])
            if sampled.size:
                clock.update(sampled)
        for column in chunk[len(at) :]:
            first, last = np.fmin.reduce(column, initial=first), np.fmax.reduce(column, initial=last)
        held = [*held, chunk[time is not None : len(at)]] if values[0].count <= hold else []
    complete, rows = min(check.finish() for check in values), values[0].count
    if complete < rows:
        samples, dropped = scan(table, roles, options, tolerance, hold, complete), rows - complete
        incomplete = "row is incomplete and was" if dropped == 1 else f"{dropped} rows are incomplete and were"
        return replace(samples, remark=f", the last {incomplete} left out{samples.remark}")
    if clock is None and rows < 2:
        raise RecordingError(f"{table.path}: has {rows} data row{'' if rows == 1 else 's'}, and a recording needs two")
    for k in unread:
        _refuse_other_clock(table, k, last - first, (rows - 1) * unit, unit)
    samples = Scan(
        clock.sample_time() if clock else unit,
        clock.resolution * unit if clock else 0.0,
        rows,
        tuple((check.low, check.high) for check in values[len(at) - len(signals) :]),
        partial(iter, (np.concatenate(held, axis=1),)) if held else partial(_streamed, table, signals, rows),
        sum(check.bad for check in values),
    )
    if options.resample is None or clock is None:
        return samples
    length = int(clock.duration_s / options.resample + 1e-9) + 1
    if not 2 <= length <= MOST_SAMPLES:
        raise RecordingError(
            f"{table.path}: --resample {options.resample:g} gives {length} samples of {clock.duration_s:g} s; take "
            "another period"
        )
    return replace(
        samples,
        sample_time=options.resample,
        time_resolution=0.0,
        length=length,
        signals=partial(_interpolated, table, at, rows, options.resample / unit),
        remark=f", interpolated from {rows} rows at the times of the file",
    )


def _refuse_other_clock(table: Table, time: int, by_clock: float, by_option: float, period: float) -> None:
    """Refuse a sampling period that contradicts a time column; a column that stands still is ignored."""
    column = table.columns[time]
    by_clock *= seconds_per_unit(table, column)
    if by_clock > 0.0 and abs(by_clock - by_option) > CLOCK_TOLERANCE * by_clock:
        raise RecordingError(
            f"{table.path}: lasts {quantity(by_clock, 's')} by its time column {column.name!r} and "
            f"{quantity(by_option, 's')} by "
            f"--sample-time {period:g}; leave out --sample-time, or give --resample where "
            "the times are uneven, or --time none where that column is not a clock"
        )


def _streamed(table: Table, at: Sequence[int], rows: int) -> Iterator[Matrix]:
    return limited(table.chunks(at), rows)


def _interpolated(table: Table, at: Sequence[int], rows: int, period: float) -> Iterator[Matrix]:
    """The signals every ``period`` in units of the time column, which comes first and never falls."""
    last_row = np.empty((len(at), 0))
    first, done = None, 0
    for chunk in rechunk(_streamed(table, at, rows), CHUNK):
        window = np.concatenate([last_row, chunk], axis=1)
        first = window[0, 0] if first is None else first
        stop = int((window[0, -1] - first) / period + 1e-9) + 1
        times = first + period * np.arange(done, stop)
        yield np.stack([np.interp(times, window[0], signal) for signal in window[1:]])
        last_row, done = chunk[:, -1:].copy(), stop
