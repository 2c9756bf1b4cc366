"""A table of numbers in a file of any known format, told by its content and never by its suffix.

A table is a path, its columns and two verbs: ``pieces(at)`` streams the columns at those positions as float64 arrays of
shape (columns, rows) in memory that does not grow with the file, and ``where(row)`` says in the user's own count where
a row is. A missing cell arrives as NaN; what NaN means is judged in :mod:`piezo_model.recordings.checks`.

A format is a file in :mod:`piezo_model.recordings.formats`; that folder is the registry.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.pieces import Elapsed, RecordingError, check_sample_time, first_line
from piezo_model.units import canonical, split_unit
from solvers.arrays import Matrix

HEAD_BYTES = 1 << 18
"""Bytes at the start of a file by which its format is told; the header of a text must lie within them."""
CHANNEL_ROWS = 1 << 17
Kind = Literal["number", "clock", "flag", "text", "empty"]
KINDS_OF_ARRAYS: Mapping[str, Kind] = {**dict.fromkeys("iuf", "number"), **dict.fromkeys("mM", "clock"), "b": "flag"}
"""By the letter that NumPy has for a type."""


@dataclass(frozen=True)
class Reading:
    """What the user says about a file because the file does not."""

    sample_time: float | None = None
    """Sampling period in seconds; a time column is not looked at then."""
    header_row: int | None = None
    """Row of a text or a sheet that names the columns, counted from 1; 0 for none."""
    decimal: str | None = None
    """Decimal mark of a text: "." or ","."""
    sheet: str | None = None
    """Sheet of a workbook."""
    resample: float | None = None
    """Sampling period in seconds to interpolate to, where the times are not even."""
    input_unit: str | None = None
    output_unit: str | None = None
    """In place of what the file says, or does not."""

    def __post_init__(self) -> None:
        """Refuse what cannot be meant."""
        if self.sample_time is not None:
            check_sample_time("", self.sample_time)
        if self.resample is not None:
            check_sample_time("--resample: ", self.resample)
            if self.sample_time is not None:
                raise RecordingError(
                    "--resample goes by a time column, which --sample-time replaces; give one of the two"
                )
        for name in ("input_unit", "output_unit"):
            if getattr(self, name) is not None and not getattr(self, name).strip():
                raise RecordingError(f"the {name.replace('_', ' ')} must not be empty")
        if self.decimal not in (None, ".", ","):
            raise RecordingError(f"the decimal mark is '.' or ',', not {self.decimal!r}")
        if self.header_row is not None and self.header_row < 0:
            raise RecordingError(
                f"rows are counted from 1 (0 for no header), so the header is not in {self.header_row}"
            )


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    """As the file has it; unique where the file's are."""
    unit: str = ""
    """In ASCII, or "" where nothing says it."""
    kind: Kind = "number"
    rows: int | None = None
    """How many, where the format says so and the columns may differ."""
    sample_time: float | None = None
    """Sampling period in seconds where the file itself states it."""
    nested: bool = False
    """Whether the name is a path, ``group/channel``."""

    @classmethod
    def named(cls, name: str, unit: str = "", **more: Any) -> Column:
        """A column whose unit is stated apart, or else read from its name."""
        return cls(name, canonical(unit) or split_unit(name)[1], **more)

    @classmethod
    def of_path(
        cls, name: str, unit: str, rows: int, sample_time: float | None, kind: Kind = "number", nested: bool = True
    ) -> Column:
        """A column named by its path, of which the last part may tell the unit."""
        last = name.rpartition("/")[2] if nested else name
        return cls(name, canonical(unit) or split_unit(last)[1], kind, rows, sample_time, nested)

    @property
    def stem(self) -> str:
        """The name without its unit and without the path to it, where that has words of its own."""
        last = self.name.rpartition("/")[2] if self.nested else self.name
        return split_unit(last if re.search(r"[^\W\d]", last) else self.name.replace("/", " "))[0]


class Table(Protocol):
    """An opened file; its columns are read on demand."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def columns(self) -> Sequence[Column]:
        """In the order of the file."""

    @property
    def form(self) -> str:
        """How the file was understood, as a clause of a sentence."""

    def pieces(self, at: Sequence[int]) -> Iterator[Matrix]:
        """Stream the columns at these positions as arrays of shape (columns, rows)."""

    def where(self, row: int) -> str:
        """Where a row is, counted from 0, as a user would look for it."""


@dataclass(frozen=True)
class Channel:
    """A column that can be read from any row to any other."""

    column: Column
    read: Callable[[int, int], NDArray]
    """Values from one row to before another, times as datetime64 or timedelta64; must survive pickling."""


@dataclass(frozen=True)
class ChannelTable:
    """Arrays by name, as the scientific formats keep them; they need not be of one length."""

    path: Path
    form: str
    channels: Sequence[Channel] = field(repr=False)

    def __post_init__(self) -> None:
        """Refuse a file that has none."""
        if not self.channels:
            raise RecordingError(f"{self.path}: is {self.form} without a column of numbers")

    @property
    def columns(self) -> tuple[Column, ...]:
        """Of all channels."""
        return tuple(channel.column for channel in self.channels)

    def pieces(self, at: Sequence[int]) -> Iterator[Matrix]:
        """Stream channels of one length as arrays of shape (columns, rows)."""
        chosen = [self.channels[k] for k in at]
        lengths = {channel.column.name: channel.column.rows or 0 for channel in chosen}
        if len(set(lengths.values())) > 1:
            raise RecordingError(
                f"{self.path}: the columns are not of one length: "
                + ", ".join(f"{name!r} has {rows} rows" for name, rows in lengths.items())
            )
        clocks = [Elapsed() for _ in chosen]
        for start in range(0, max(lengths.values()), CHANNEL_ROWS):
            stop = min(start + CHANNEL_ROWS, max(lengths.values()))
            with parsed(self.path, self.form):
                read = [channel.read(start, stop) for channel in chosen]
                piece = np.stack(
                    [
                        clock.seconds(values) if values.dtype.kind in "mM" else np.asarray(values, dtype=np.float64)
                        for values, clock in zip(read, clocks, strict=True)
                    ]
                )
            yield piece

    def where(self, row: int) -> str:
        """Data row, for a row counted from 0."""
        return f"data row {row + 1}"


@contextmanager
def parsed(path: Path, form: str) -> Iterator[None]:
    """Say in a sentence that a file is damaged, whatever the library that parses the format makes of it."""
    try:
        yield
    except (RecordingError, ModuleNotFoundError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:
        raise RecordingError(f"{path}: is a damaged {form.partition(',')[0]} file: {first_line(error)}") from None


def in_memory(
    path: Path,
    form: str,
    arrays: Mapping[str, NDArray],
    units: Mapping[str, str] | None = None,
    sample_time: float | None = None,
) -> ChannelTable:
    """Make a table of one- and two-dimensional arrays; a matrix becomes columns ``name/1``, ``name/2``, …"""
    units, channels = units or {}, []
    for name, array in arrays.items():
        for label, values in columns_of(name, array):
            kind = KINDS_OF_ARRAYS[values.dtype.kind]
            column = Column.of_path(label, units.get(name, ""), values.size, sample_time, kind)
            channels.append(Channel(column, array_slice(values)))
    return ChannelTable(path, form, channels)


def columns_of(name: str, array: NDArray) -> Iterator[tuple[str, NDArray]]:
    """The columns of numbers that an array holds, each with its name; none where it holds something else."""
    if array.dtype.names:
        for part in array.dtype.names:
            yield from columns_of(f"{name}/{part}" if name else part, array[part])
    elif array.dtype.kind in KINDS_OF_ARRAYS and array.size > 1:
        array = array.squeeze()
        if array.ndim == 1:
            yield name or "column 1", array
        elif array.ndim == 2:
            long = array if array.shape[0] >= array.shape[1] else array.T
            for k in range(long.shape[1]):
                yield f"{name}/{k + 1}" if name else f"column {k + 1}", long[:, k]


def array_slice(values: NDArray) -> Callable[[int, int], NDArray]:
    """How a channel of an array in memory is read."""
    return partial(_rows, values)


def _rows(values: NDArray, start: int, stop: int) -> NDArray:
    return values[start:stop]
