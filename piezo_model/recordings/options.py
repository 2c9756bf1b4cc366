"""Options for what a file does not state, common to all ways of opening one."""

from dataclasses import dataclass

from piezo_model.recordings.table import RecordingError, check_sample_time

TIME_TOLERANCE = 0.01
"""Largest relative deviation of an interval from the sampling period."""


@dataclass(frozen=True)
class ReadOptions:
    """Properties of a file, and the part of it that is read.

    Raises
    ------
    RecordingError
        Impossible values, or two that exclude each other.
    """

    sample_time: float | None = None
    """Sampling period in seconds; a time column is then ignored."""
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
    time_tolerance: float = TIME_TOLERANCE
    """Largest relative deviation of an interval from the sampling period, in addition to the rounding of printed
    times."""

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        for label, period in (("", self.sample_time), ("--resample: ", self.resample)):
            if period is not None:
                check_sample_time(label, period)
        empty = [name for name in ("input", "output", "time") if (getattr(self, f"{name}_unit") or "?").isspace()]
        for wrong, sentence in (
            (
                self.resample and self.sample_time,
                "--resample needs a time column, which --sample-time replaces; give one of the two",
            ),
            (empty, f"the {' and '.join(empty)} unit must not be empty"),
            (self.decimal not in (None, ".", ","), f"the decimal mark is '.' or ',', not {self.decimal!r}"),
            (
                (self.header_row or 0) < 0,
                f"the header row must be at least 1, or 0 for no header, not {self.header_row}",
            ),
            (self.decimate is not None and self.decimate < 1, f"--decimate must be at least 1, not {self.decimate}"),
            (
                not (self.from_s or 0.0) < (float("inf") if self.to_s is None else self.to_s),
                f"--from {self.from_s or 0.0:g} must be before --to {self.to_s or 0.0:g}",
            ),
            (
                not 0.0 < self.time_tolerance < 0.5,
                f"the time tolerance must be a fraction of the period between 0 and 0.5, not {self.time_tolerance}",
            ),
        ):
            if wrong:
                raise RecordingError(sentence)
