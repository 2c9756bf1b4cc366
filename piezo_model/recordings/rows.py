"""The rows of a recording while they are checked and repaired, and their order in time: sorted rows, repeated time
stamps, and restarts or pauses of the times, at which a part begins."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from piezo_model.recordings.table import RecordingError, RowName
from solvers.arrays import Index, Mask, Vector

LEAST_ROWS = 64
"""Fewest rows in which a value can be recognised as unlike the others."""
LEAST_PART = 16
"""Fewest rows of a part."""
LEAST_RETURN = 0.5
"""Smallest step back of the times at the end of a part, relative to its duration."""
LEAST_PAUSE = 10.0
"""Shortest pause between two parts, in sampling periods and in neighbouring steps; a shorter one is a gap."""
WINDOW = 65536
"""Rows at the start from which the usual step is estimated, and at the start and the end the rounding of times."""
TO_AND_FRO, LEAST_JUMP = 10.0, 0.02
"""Travel of a signal that is no single run, and its smallest mean step if it is out of order, both in ranges."""


@dataclass
class Rows:
    """Times and signals, shape (rows,) each; the drive comes first, and the output second if there is one."""

    path: object
    """Name of the file, with which every error begins."""
    labels: list[str]
    """Names of the signals in sentences."""
    signals: list[Vector]
    where: RowName
    """Name of a row as the user counts rows."""
    times: Vector
    """Numbers of the rows if there is no clock."""
    time_label: str = ""
    """Empty if there is no clock."""
    unit: float = 1.0
    """Unit of the times in seconds."""
    uncounted: Mask = field(init=False)
    """Mask of rows whose values were not measured."""
    starts: list[int] = field(default_factory=lambda: [0])
    """First row of each part."""
    remarks: list[str] = field(default_factory=list)
    repairs: list[str] = field(default_factory=list)
    """What was changed, as clauses."""

    def __post_init__(self) -> None:
        """Count every row."""
        self.uncounted = np.zeros(self.length, dtype=bool)

    @property
    def length(self) -> int:
        """Number of rows."""
        return self.signals[0].size

    def select(self, selection: Index) -> None:
        """Keep some rows; a part starts at the first of its remaining rows."""
        where = self.where
        self.where = lambda row: where(int(selection[row]))
        self.signals = [signal[selection] for signal in self.signals]
        self.times, self.uncounted = self.times[selection], self.uncounted[selection]
        self.starts = np.unique(np.searchsorted(selection, self.starts)).tolist()

    def replace(self, k: int, bad: Mask | list[int]) -> None:
        """Interpolate bad values of a signal, which then do not count."""
        at = np.arange(self.length)
        known = np.delete(at, bad)
        self.signals[k] = np.interp(at, known, self.signals[k][known])
        self.uncounted[bad] = True

    def seconds(self, time: float) -> str:
        """A time or duration in seconds, for a sentence."""
        return f"{time * self.unit:.9g} s"

    def refusal(self, sentence: str) -> RecordingError:
        """A sentence about the times, as an error."""
        return RecordingError(f"{self.path}: {self.time_label} {sentence}")

    def named(self, at: Index, most: int = 3) -> str:
        """Names of the first of some rows, for a sentence."""
        return ", ".join(self.where(int(row)) for row in at[:most]) + f" and {at.size - most} more" * (at.size > most)


def refuse_sorted(rows: Rows) -> None:
    """Refuse rows of two signals without times that are sorted by one while the other jumps back and forth.

    Raises
    ------
    RecordingError
        The order in time, which hysteresis needs, is lost.
    """
    for label, ordered, other in zip(rows.labels, rows.signals, rows.signals[::-1], strict=True):
        steps, span = np.diff(ordered), float(np.ptp(other))
        is_ordered = ((steps >= 0.0).all() or (steps <= 0.0).all()) and steps.any()
        travel = float(np.abs(np.diff(other)).sum())
        jumps = travel > LEAST_JUMP * rows.length * span or not steps.all()
        if not rows.time_label and is_ordered and travel > TO_AND_FRO * span > 0.0 and jumps:
            raise RecordingError(
                f"{rows.path}: {label} only {'rises' if steps.max() > 0.0 else 'falls'} while the other signal goes "
                "back and forth: the rows are sorted by it, and their order in time, which hysteresis needs, is lost"
            )


def run_starts(times: Vector) -> list[int]:
    """The first row of each run of rising times."""
    return [0, *(np.flatnonzero(np.diff(times) < 0.0) + 1).tolist()]


def begin_parts(rows: Rows, even: bool = True) -> None:
    """Begin a part where the times, of at least two rows, start again or after a pause, and make them continuous over
    the parts.

    Raises
    ------
    RecordingError
        With ``even``, parts with different sampling rates; otherwise a gap next to too few rows for a part, which would
        be interpolated.
    """
    times = rows.times
    steps = np.diff(times)
    positive = steps[:WINDOW][steps[:WINDOW] > 0.0]
    usual = float(np.median(positive)) if positive.size else 0.0
    runs = run_starts(times)
    returns = [
        times[at] - times[at - 1] < -LEAST_RETURN * (times[at - 1] - times[a]) and steps[at - 2] <= LEAST_PAUSE * usual
        for a, at in pairwise(runs)
    ]
    if returns and min(np.diff([*runs, rows.length])) >= LEAST_PART and all(returns):
        rows.starts = sorted({*rows.starts, *runs})
        rows.remarks.append(f"{len(runs)} parts: the times start again in {rows.named(np.array(runs[1:]))}")
    long = np.flatnonzero(steps > LEAST_PAUSE * usual)
    alone = steps[long] > LEAST_PAUSE * np.maximum(steps[long - 1], np.abs(steps[(long + 1) % steps.size]))
    pauses = np.setdiff1d(long[alone] + 1, rows.starts)
    long_enough = min(np.diff(sorted({*rows.starts, *pauses.tolist(), rows.length}))) >= LEAST_PART
    if pauses.size and not even and not long_enough:
        raise rows.refusal(
            f"has a gap before {rows.named(pauses)} and fewer than {LEAST_PART} rows next to it; exclude these rows "
            "with --from or --to"
        )
    if pauses.size and long_enough:
        rows.starts = sorted({*rows.starts, *pauses.tolist()})
        rows.repairs.append(
            f"{pauses.size} pause{'s' * (pauses.size > 1)} in its times, before {rows.named(pauses)}: "
            "a new part begins there"
        )
    if later := rows.starts[1:]:
        first = later[0]
        rising = first > 1 and (steps[: first - 1] > 0.0).all()
        period = (times[first - 1] - times[0]) / (first - 1) if rising else usual
        leap = np.zeros(rows.length)
        leap[later] = period - steps[np.array(later) - 1]
        rows.times = times + np.cumsum(leap)


def drop_repeats(rows: Rows) -> None:
    """Drop the rows that repeat the previous time, if all of them repeat its values, too."""
    again = np.flatnonzero(np.diff(rows.times) == 0.0) + 1
    if again.size and not any(np.diff(signal)[again - 1].any() for signal in rows.signals):
        rows.repairs.append(
            f"{again.size} of {rows.length} rows repeat the time of the previous row and its values, and were dropped"
        )
        rows.select(np.delete(np.arange(rows.length), again))
