"""Options for what a file does not state, common to all ways of opening one."""

import math
from dataclasses import dataclass

from piezo_model import checks
from piezo_model.recordings.table import RecordingError
from piezo_model.structure import SAMPLE_TIMES

VALID = {
    **dict.fromkeys(
        ("sample_time", "resample"),
        (
            lambda seconds: SAMPLE_TIMES[0] <= seconds <= SAMPLE_TIMES[1],
            "a sampling period from {:g} to {:g} s".format(*SAMPLE_TIMES),
        ),
    ),
    "header_row": (lambda row: isinstance(row, int) and row >= 0, "the number of a row, or 0 for no header"),
    "decimal": (lambda mark: mark in (".", ","), "the decimal mark '.' or ','"),
    **dict.fromkeys(("input_unit", "output_unit", "time_unit"), (str.strip, "the name of a unit")),
    **dict.fromkeys(("from_s", "to_s"), (lambda seconds: seconds > -math.inf, "a time in seconds")),
    "decimate": (lambda step: isinstance(step, int) and step >= 1, "a whole number of at least 1"),
    "time_tolerance": (lambda share: 0.0 < share < 0.5, "a fraction of the period between 0 and 0.5"),
}
"""What the value of an option must be: a test, and words."""


@dataclass(frozen=True)
class ReadOptions:
    """Properties of a file, and the part of it that is read.

    Raises
    ------
    RecordingError
        Impossible values, or two that exclude each other.
    """

    sample_time: float | None = None
    """Sampling period in seconds of a file without a time column."""
    header_row: int | None = None
    """Row of a text or a sheet that names the columns, counted from 1; 0 for none."""
    decimal: str | None = None
    """Decimal mark of a text: "." or ","."""
    table: str | None = None
    """Number or name of one of several tables: the text above it, or its sheet."""
    resample: float | None = None
    """Sampling period in seconds to interpolate to, for uneven times."""
    input_unit: str | None = None
    output_unit: str | None = None
    time_unit: str | None = None
    """Override the units in the file."""
    from_s: float | None = None
    to_s: float | None = None
    """Read the rows between these times, in seconds after the first time."""
    decimate: int | None = None
    """Read one row in so many."""
    strict: bool = False
    """Refuse a file instead of repairing it."""
    time_tolerance: float = 0.01
    """Largest relative deviation of an interval from the sampling period, in addition to the rounding of printed
    times."""

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        with checks.refusing(RecordingError):
            for name, (valid, what) in VALID.items():
                if (value := getattr(self, name)) is not None:
                    checks.require(valid, what, **{name: value})
        checks.check(
            self.resample is None or self.sample_time is None,
            "--resample needs a time column, which --sample-time replaces; give one of the two",
            RecordingError,
        )
        checks.check(
            (self.from_s or 0.0) < (math.inf if self.to_s is None else self.to_s),
            f"--from {self.from_s or 0.0:g} must be before --to {self.to_s or 0.0:g}",
            RecordingError,
        )
