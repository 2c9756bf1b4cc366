"""Values that were not measured: unknown values, which are missing, infinite, or codes such as 9.9e37; isolated bad
samples, far from both neighbours and without effect on the other signal; and dropouts, in which the output repeatedly
takes one value beyond all others.

Unknown outputs are not counted, in gaps of any length, up to half of the rows. An unknown drive is interpolated over a
few rows; after a longer gap the states of the operators are unknown, and the recording is refused.

A real jump of the drive persists, recurs, or moves the output; a bad sample does none of this. A bad drive is replaced
before the operators see it, and the sample is not counted.
"""

import math

import numpy as np

from piezo_model.recordings.rows import LEAST_ROWS, Rows
from piezo_model.recordings.table import ABSURD, RecordingError
from solvers.arrays import Index, Mask, Vector

FILLED, MOST_MISSING = 0.01, 0.5
"""Largest fraction of rows whose drive is interpolated, and largest fraction of rows without an output."""
LONGEST_FILL = 10
"""Most consecutive missing values of the drive that are interpolated."""
MOST_BAD = 2
"""Most bad samples of a signal; more are a property of the signal."""
FEWEST = 16
"""Fewest new values of a sensor slower than the drive."""
UNLIKE = 10.0
"""Smallest ratio of the steps to and from a bad sample to all other steps."""
RETURN = 0.2
"""Largest distance between the two neighbours, relative to the step."""
ANSWER = 4.0
"""Smallest ratio of the other signal's steps after a jump to its steps elsewhere, at which it responds to the jump."""
REACH = 3
"""Samples after a jump within which the other signal responds."""
LEAST_DROPPED, MOST_DROPPED, BEYOND = 3, 0.05, 0.05
"""Fewest samples, and largest fraction of samples, in dropouts; smallest distance of their value from all others,
relative to the range of these (a limit of the sensor is nearer)."""
EVEN, UNEQUAL = 0.95, 1.5
"""Of a sensor slower than the drive: smallest fraction of equal intervals between new values, and smallest ratio of the
numbers of drive movements and new values."""
SHOWN = 1 << 16
"""Rows from the start in which a held output is looked for."""


def unknown(values: Vector) -> Mask:
    """Mask of values that are missing, infinite, or codes."""
    return ~(np.abs(values) < ABSURD)


def bad_value(rows: Rows, label: str, values: Vector) -> RecordingError:
    """The first unknown value of a column, as an error."""
    bad = np.flatnonzero(unknown(values))
    absurd = ", which is too large for a measured value" if math.isfinite(values[bad[0]]) else ""
    in_all = f"; in all {bad.size} of {values.size} values are missing, infinite or implausible" if bad.size > 1 else ""
    return RecordingError(
        f"{rows.path}: {label} is {_kind(values[bad[0]])} in {rows.where(int(bad[0]))}{absurd}{in_all}"
    )


def _kind(value: float) -> str:
    return "missing" if math.isnan(value) else "infinite" if math.isinf(value) else f"{value:g}"


def interpolate_unknown(rows: Rows) -> None:
    """Drop the rows after the last complete one, and interpolate unknown values of the signals, which do not count.

    Raises
    ------
    RecordingError
        An unknown time; unknown values of the drive in the first row, in many rows, or in succession; unknown outputs
        in most rows, unless the sensor is slower than the drive.
    """
    complete = np.flatnonzero(~np.any([unknown(values) for values in (rows.times, *rows.signals)], axis=0))
    if complete.size and complete[-1] < rows.length - 1:
        rows.repairs.append(f"incomplete rows at the end are left out: {rows.length - 1 - complete[-1]}")
        rows.select(np.arange(complete[-1] + 1))
    columns = [(rows.time_label, rows.times), *zip(rows.labels, rows.signals, strict=True)]
    for k, (label, values) in enumerate(columns, start=-1):
        if not (bad := unknown(values)).any():
            continue
        at, steps = np.flatnonzero(bad), np.diff(np.flatnonzero(~bad))
        if k > 0:
            slower = steps.size >= FEWEST and steps.max() <= 2.0 * np.median(steps)
            too_many = at.size > MOST_MISSING * rows.length and not slower
        else:
            most = max(FILLED * rows.length, MOST_BAD * (rows.length >= LEAST_ROWS))
            too_many = k < 0 or bad[0] or steps.max(initial=1) > LONGEST_FILL + 1 or at.size > most
        if too_many:
            raise RecordingError(f"{bad_value(rows, label, values)}; --from and --to read the rows before or after")
        rows.repairs.append(
            f"{label} is {_kind(values[at[0]])} in {rows.named(at)}: {at.size} of {rows.length} samples are "
            "interpolated and not counted in the fit"
        )
        rows.replace(k, bad)


def discount_held_outputs(rows: Rows) -> None:
    """Count only the changes of an output that holds each value for equally many rows while the drive moves."""
    drive, output = (np.diff(signal[:SHOWN]) for signal in rows.signals)
    steps = output[fresh := np.flatnonzero(output)]
    run_lengths = np.diff(fresh)
    even = (
        run_lengths.size > FEWEST
        and run_lengths.min() > 1
        and np.mean(np.abs(run_lengths - np.median(run_lengths)) <= 1.0) > EVEN
    )
    if even and np.unique(np.abs(steps)).size > FEWEST and np.count_nonzero(drive) > UNEQUAL * fresh.size:
        stale = np.diff(rows.signals[1], prepend=np.nan) == 0.0
        rows.repairs.append(
            f"{rows.labels[1]} holds each value for {np.median(run_lengths):g} rows, as of a sensor slower than the "
            f"drive: {np.count_nonzero(stale)} of {rows.length} samples are interpolated and not counted in the fit"
        )
        rows.replace(1, stale)


def replace_bad_samples(rows: Rows) -> None:
    """Report and interpolate dropouts and isolated bad samples."""
    for k, (label, values) in enumerate(zip(rows.labels, rows.signals, strict=True)):
        if k and (dropped := _dropped_out(values, rows.signals[0])).any():
            rows.repairs.append(
                f"{label} is {values[dropped][0]:.6g} in {rows.named(np.flatnonzero(dropped))}, beyond all others: "
                "a sensor dropout, not counted in the fit"
            )
            rows.replace(k, dropped)
            values = rows.signals[k]
        others = [_steps(rows, signal) for j, signal in enumerate(rows.signals) if j != k]
        isolated = _isolated(values, _steps(rows, values)).tolist()
        bad = [row for row in isolated if not any(_answers(steps, row) for steps in others)]
        for row in bad:
            neighbours = " and ".join(f"{values[j]:.6g}" for j in (row - 1, row + 1) if 0 <= j < rows.length)
            rows.repairs.append(
                f"{label} is {values[row]:.6g} in {rows.where(row)} next to {neighbours}: an isolated bad sample, "
                "not counted in the fit"
            )
        if bad:
            rows.replace(k, bad)


def _steps(rows: Rows, values: Vector) -> Vector:
    """Sizes of the steps between samples, 0 between parts."""
    steps = np.abs(np.diff(values))
    steps[np.array(rows.starts[1:], dtype=int) - 1] = 0.0
    return steps


def _largest(steps: Vector) -> float:
    """The largest step without those of bad samples (two for each), and without one real jump."""
    rank = min(2 * MOST_BAD + 2, steps.size)
    return float(np.partition(steps, -rank)[-rank])


def _isolated(values: Vector, steps: Vector) -> Index:
    """Samples far from both neighbours, or from the only one at an end; none if there are more than ``MOST_BAD``."""
    least = UNLIKE * _largest(steps)
    to, of = np.pad(steps, 1, mode="edge"), np.pad(values, 1, mode="reflect")
    far = (np.minimum(to[:-1], to[1:]) > least) & (np.abs(of[2:] - of[:-2]) < RETURN * to[:-1])
    far[[0, -1]] &= ~far[[1, -2]]
    return np.flatnonzero(far) if least > 0.0 and np.count_nonzero(far) <= MOST_BAD else np.empty(0, dtype=int)


def _dropped_out(values: Vector, drive: Vector) -> Mask:
    """Mask of outputs that are one value far beyond all others, while the drive is within its usual range."""
    for value in (np.fmin.reduce(values), np.fmax.reduce(values)):
        equal = values == value
        others, x = values[~equal], drive[~equal]
        if (
            LEAST_DROPPED <= np.count_nonzero(equal) <= MOST_DROPPED * values.size
            and abs(value - np.clip(value, low := np.fmin.reduce(others), high := np.fmax.reduce(others)))
            > BEYOND * (high - low)
            and x.min() <= np.median(drive[equal]) <= x.max()
        ):
            return equal
    return np.zeros(values.size, dtype=bool)


def _answers(steps: Vector, row: int) -> bool:
    """True if a signal responds to a jump of the other at a row."""
    return bool((steps[max(row - 1, 0) : row + REACH] > ANSWER * _largest(steps)).any())
