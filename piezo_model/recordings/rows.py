"""The rows of a recording while they are checked and repaired: what one repair changes, all others see."""

from dataclasses import dataclass, field

import numpy as np

from piezo_model.recordings.table import RowName
from solvers.arrays import Index, Mask, Vector

LEAST_ROWS = 64
"""Fewest rows in which a value can be told to be unlike the others."""


NEAR = 0.75
"""Largest distance of an interpolated value from a measured one, in sampling periods; farther ones are not counted."""


def is_near(grid: Vector, times: Vector, period: float) -> Mask:
    """Whether one of ascending times is near each time of a grid."""
    after = np.searchsorted(times, grid).clip(1, times.size - 1)
    return np.minimum(np.abs(grid - times[after - 1]), np.abs(times[after] - grid)) <= NEAR * period


@dataclass
class Rows:
    """Times and signals, shape (rows,) each; the drive comes first, and the output second if there is one."""

    path: object
    """Name of the file, with which every error begins."""
    labels: list[str]
    """Names of the signals in sentences."""
    signals: list[Vector]
    where: RowName
    """Name of a row, as the user counts rows."""
    time_label: str = ""
    times: Vector | None = None
    """In any unit; None where the period is known without times."""
    uncounted: Mask = field(init=False)
    """Rows whose values are not measured ones."""
    starts: list[int] = field(default_factory=lambda: [0])
    """First row of each part."""
    remarks: list[str] = field(default_factory=list)
    repairs: list[str] = field(default_factory=list)
    """What was changed, in clauses."""

    def __post_init__(self) -> None:
        """Count every row."""
        self.uncounted = np.zeros(self.length, dtype=bool)

    @property
    def length(self) -> int:
        """Number of rows."""
        return self.signals[0].size

    def take(self, kept: Index | slice) -> None:
        """Keep some rows, in this order; a part starts at the first of its rows that are left."""
        self.signals = [signal[kept] for signal in self.signals]
        self.times = None if self.times is None else self.times[kept]
        self.uncounted = self.uncounted[kept]
        if not isinstance(kept, slice):
            where = self.where
            self.where = lambda row: where(int(kept[row]))
            self.starts = np.unique(np.searchsorted(kept, self.starts)).tolist()

    def replace(self, k: int, bad: Mask) -> None:
        """Draw straight lines over bad values of a signal, which then do not count."""
        at = np.arange(self.length)
        self.signals[k] = np.interp(at, at[~bad], self.signals[k][~bad])
        self.uncounted |= bad

    def named(self, at: Index, most: int = 3) -> str:
        """The first of some rows, as a list for a sentence."""
        names = [self.where(int(row)) for row in at[:most]]
        return ", ".join(names) + (f" and {at.size - most} more" if at.size > most else "")
