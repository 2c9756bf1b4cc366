"""A table of numbers in a file of any known format, recognised by its content and never by its suffix.

A table is a path, its columns and two methods: ``chunks(at)`` streams the columns at those positions as float64 arrays
of shape (columns, rows) in memory that does not grow with the file, and ``where(row)`` names a row as the user counts
rows. A format defines only how its ``batches`` are read. A missing cell becomes NaN, which
:mod:`piezo_model.recordings.scan` checks.

A format is a file in :mod:`piezo_model.recordings.formats`; that folder is the registry.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.chunks import Elapsed, RecordingError, check_sample_time, first_line
from piezo_model.units import canonical, split_unit
from solvers.arrays import Matrix

HEAD_BYTES = 1 << 18
"""Bytes at the start of a file that determine its format; the header of a text must lie within them."""
BATCH_ROWS = 1 << 17
Kind = Literal["number", "clock", "flag", "text", "empty"]
KINDS_OF_ARRAYS: Mapping[str, Kind] = {**dict.fromkeys("iuf", "number"), **dict.fromkeys("mM", "clock"), "b": "flag"}
"""Kind of a column by the kind code of its NumPy type."""


@dataclass(frozen=True)
class ReadOptions:
    """Properties of a file that the user gives because the file does not."""

    sample_time: float | None = None
    """Sampling period in seconds; a time column is then ignored."""
    header_row: int | None = None
    """Row of a text or a sheet that names the columns, counted from 1; 0 for none."""
    decimal: str | None = None
    """Decimal mark of a text: "." or ","."""
    sheet: str | None = None
    """Sheet of a workbook."""
    resample: float | None = None
    """Sampling period in seconds to interpolate to, for uneven times."""
    input_unit: str | None = None
    output_unit: str | None = None
    """Override the units in the file."""

    def __post_init__(self) -> None:
        """Refuse impossible values."""
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
    """Name in the file; not necessarily unique."""
    unit: str = ""
    """Unit in ASCII; "" if unknown."""
    kind: Kind = "number"
    rows: int | None = None
    """Number of rows, if the format states it."""
    sample_time: float | None = None
    """Sampling period in seconds, if the file states it."""
    nested: bool = False
    """Whether the name is a path, ``group/channel``."""

    @classmethod
    def named(cls, name: str, unit: str = "", **more: Any) -> Column:
        """A column with a given unit, or else the unit in its name, or in the last part of its path."""
        last = name.rpartition("/")[2] if more.get("nested") else name
        return cls(name, canonical(unit) or split_unit(last)[1], **more)

    @property
    def stem(self) -> str:
        """The name without its unit, and without its path if its last part has a letter."""
        last = self.name.rpartition("/")[2] if self.nested else self.name
        return split_unit(last if re.search(r"[^\W\d]", last) else self.name.replace("/", " "))[0]


@dataclass(frozen=True)
class Table(ABC):
    """An opened file; its columns are read on demand."""

    path: Path
    form: str
    """Format and dialect of the file, as a clause of a sentence."""
    columns: tuple[Column, ...]
    """In the order of the file."""

    @abstractmethod
    def batches(self, at: Sequence[int]) -> Iterable[Sequence[NDArray]]:
        """Stream the columns at these positions, times as datetime64 or timedelta64, some rows at a time."""

    def chunks(self, at: Sequence[int]) -> Iterator[Matrix]:
        """Stream the columns at these positions as arrays of shape (columns, rows), times in seconds since the
        first."""
        clocks = [Elapsed() for _ in at]
        for batch in self.batches(at):
            yield np.stack(
                [
                    clock.seconds(values) if values.dtype.kind in "mM" else np.asarray(values, dtype=np.float64)
                    for values, clock in zip(batch, clocks, strict=True)
                ]
            )

    def where(self, row: int) -> str:
        """Name of a row, counted from 0, as the user counts rows."""
        return f"data row {row + 1}"


@dataclass(frozen=True)
class ArrayTable(Table):
    """Named arrays of any lengths, as in scientific formats."""

    arrays: Sequence[Any] = field(repr=False)
    """One for each column, read by slices; they can be pickled."""

    def __post_init__(self) -> None:
        """Refuse a file without columns."""
        if not self.columns:
            raise RecordingError(f"{self.path}: is {self.form} without a column of numbers")

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream arrays of one length."""
        lengths = {self.columns[k].name: self.columns[k].rows or 0 for k in at}
        if len(set(lengths.values())) > 1:
            raise RecordingError(
                f"{self.path}: the columns are not of one length: "
                + ", ".join(f"{name!r} has {rows} rows" for name, rows in lengths.items())
            )
        for start in range(0, max(lengths.values()), BATCH_ROWS):
            with parsed(self.path, self.form):
                batch = [np.asarray(self.arrays[k][start : start + BATCH_ROWS]) for k in at]
                if len({len(values) for values in batch}) > 1:
                    raise ValueError("its columns do not have the rows that it states")
            yield batch


@contextmanager
def parsed(path: Path, form: str) -> Iterator[None]:
    """Turn any exception of a parsing library into a sentence that the file is damaged."""
    try:
        yield
    except (RecordingError, ModuleNotFoundError, FileNotFoundError, PermissionError, MemoryError):
        raise
    except Exception as error:
        raise RecordingError(f"{path}: is a damaged {form.partition(',')[0]} file: {first_line(error)}") from None


def in_memory(
    path: Path,
    form: str,
    arrays: Mapping[str, Any],
    *,
    units: Mapping[str, str] | None = None,
    sample_time: float | Mapping[str, float | None] | None = None,
    nested: bool = True,
) -> ArrayTable:
    """Make a table of one- and two-dimensional arrays; a matrix becomes columns ``name/1``, ``name/2``, …

    Units and sampling periods are given by name, or one period for all; with ``nested`` the names are paths.
    """
    columns, kept = [], []
    for name, array in arrays.items():
        period = sample_time.get(name) if isinstance(sample_time, Mapping) else sample_time
        if period is not None:
            check_sample_time(f"{path}: ", period)
        for label, values in columns_of(name, array):
            kind = KINDS_OF_ARRAYS[values.dtype.kind]
            columns.append(
                Column.named(
                    label, (units or {}).get(name, ""), kind=kind, rows=len(values), sample_time=period, nested=nested
                )
            )
            kept.append(values)
    return ArrayTable(path, form, tuple(columns), kept)


def distinct(names: Sequence[str]) -> list[str]:
    """Names of columns; repeated names are numbered by their position.

    >>> distinct(["u", "y", "u"])
    ['u (1)', 'y', 'u (3)']
    """
    counts = Counter(names)
    return [f"{name} ({k + 1})" if counts[name] > 1 else name for k, name in enumerate(names)]


def columns_of(name: str, array: Any) -> Iterator[tuple[str, Any]]:
    """Names and columns of the numbers in an array; none if it holds no numbers."""
    if array.dtype.names:
        for part in array.dtype.names:
            yield from columns_of(f"{name}/{part}" if name else part, array[part])
    elif array.dtype.kind in KINDS_OF_ARRAYS and array.size > 1:
        array = array if array.ndim == 1 else np.squeeze(array)
        if array.ndim == 1:
            yield name or "column 1", array
        elif array.ndim == 2:
            long = array if array.shape[0] >= array.shape[1] else array.T
            for k in range(long.shape[1]):
                yield f"{name}/{k + 1}" if name else f"column {k + 1}", long[:, k]
