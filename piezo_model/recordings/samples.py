"""From the columns of a table to even samples: what is wrong with them is repaired where that is safe, and said, or
refused with its row.

In order: codes and missing values (`bad_values`), the order of rows, parts and repeated stamps (`rows`), the clock
(`clock`), isolated bad samples (`bad_values`), and an even clock by linear interpolation,

    y(t_0 + k T) = y_i + (y_{i+1} − y_i) (t_0 + k T − t_i) / (t_{i+1} − t_i),   t_i ≤ t_0 + k T ≤ t_{i+1}.
"""

import numpy as np

from piezo_model.recordings.bad_values import count_fresh, drop_incomplete_end, fill, replace_bad_samples
from piezo_model.recordings.clock import Clock
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.rows import Rows, begin_parts, drop_repeats, is_near, refuse_sorted, sort_by_time
from piezo_model.recordings.table import RecordingError

MOST_SAMPLES = 1_000_000_000
MOST_MULTIPLIED = 10
"""Largest ratio of samples to rows that needs no confirmation."""


def sample(rows: Rows, seconds: float, period: float, options: ReadOptions) -> tuple[float, float]:
    """Make rows even samples, in place; their sampling period, and the visible rounding of the times, in seconds.

    Parameters
    ----------
    rows : Rows
        All rows of the file that are read.
    seconds : float
        Unit of the times.
    period : float
        Sampling period, for rows without times.
    options : ReadOptions
        Tolerance of the clock, and the period of an interpolation.

    Raises
    ------
    RecordingError
        Rows that cannot be repaired, or with ``strict`` that have to be.
    """
    drop_incomplete_end(rows)
    sort_by_time(rows)
    fill(rows)
    refuse_sorted(rows)
    begin_parts(rows, even=options.resample is None)
    found = _sampling(rows, seconds, period, options)
    count_fresh(rows)
    replace_bad_samples(rows)
    if options.strict and rows.repairs:
        raise RecordingError(f"{rows.path}: {rows.repairs[0]}; without --strict that is repaired")
    return found if options.resample is None else _resampled(rows, seconds, options)


def _sampling(rows: Rows, seconds: float, period: float, options: ReadOptions) -> tuple[float, float]:
    """The sampling period of the times, and their rounding, without rows that only repeat the one before; that which is
    known for rows without times."""
    if rows.length < 2:
        raise RecordingError(
            f"{rows.path}: has {'1 data row' if rows.length else 'no data rows'}, and a recording needs two"
        )
    if rows.times is None:
        return period, 0.0
    try:
        return Clock(rows, seconds, options.time_tolerance).sampling(even=options.resample is None)
    except RecordingError:
        if not drop_repeats(rows):
            raise
    return _sampling(rows, seconds, period, options)


def _resampled(rows: Rows, seconds: float, options: ReadOptions) -> tuple[float, float]:
    """Interpolate to an even clock; a sample counts if the rows on both of its sides do."""
    times, period = rows.times, options.resample
    assert times is not None
    assert period is not None
    count, duration = rows.length, float(times[-1] - times[0]) * seconds
    length = int(duration / period + 1e-9) + 1
    if not 2 <= length <= MOST_SAMPLES:
        raise RecordingError(
            f"{rows.path}: --resample {period:g} gives {length} samples of {duration:g} s; take another period"
        )
    if length > MOST_MULTIPLIED * count and options.time_unit is None:
        raise RecordingError(
            f"{rows.path}: --resample {period:g} makes {length} samples of {count} rows over {duration:g} s; are the "
            "times in another unit? --time-unit states it, or confirms it"
        )
    grid = times[0] + period / seconds * np.arange(length)
    rows.signals = [np.interp(grid, times, signal) for signal in rows.signals]
    near = is_near(grid, times, max(period / seconds, float(np.median(np.diff(times)))))
    rows.uncounted = (np.interp(grid, times, rows.uncounted) > 0.0) | ~near
    rows.starts = np.unique(np.searchsorted(grid, times[rows.starts])).tolist()
    rows.times = grid
    far = f"; {np.count_nonzero(~near)} of {length} samples are far from a row, and not counted" * (not near.all())
    rows.remarks.append(f"interpolated from {count} rows at the times of the file{far}")
    return period, 0.0
