"""A table: named columns of a file, each read as a whole array on request.

The reader of a format yields batches of rows. ``Table.read`` joins the selected rows of the chosen columns to float64
arrays, in which a missing cell is NaN and a clock counts seconds since its first time.
"""

import re
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from piezo_model.structure import SAMPLE_TIMES
from piezo_model.units import canonical, split_unit
from solvers.arrays import Vector

Kind = Literal["number", "clock", "flag", "text", "empty"]
HEAD_ROWS = 1_000_000
"""Rows from the start by whose values a column is recognised."""
KINDS: Mapping[str, Kind] = {**dict.fromkeys("iuf", "number"), **dict.fromkeys("mM", "clock"), "b": "flag"}
"""Kind of a column by the kind code of its NumPy type."""
ABSURD = 1e30
"""Smallest magnitude that is not a measured value: instruments write 9.9e37 for an overload."""
COPIES = 4
"""Copies of each column in memory until a recording has been checked."""
MOST_COLUMNS = 10_000
MOST_BYTES = 2 << 30
"""Largest size of values that a library reads at once; it may hold another copy of them."""
FEW_ROWS = 16
"""Largest number of rows of a preamble above a longer table."""
MISTAKES = (AttributeError, LookupError, NameError, TypeError)
"""Errors that are mistakes of a program, if they arise in ours; in a library, they mean a damaged file."""
RowName = Callable[[int], str]
"""Name of a row counted from 0, as the user counts rows."""


class RecordingError(ValueError):
    """A recording cannot be read or written; the message is one sentence that names file, column and row."""


@contextmanager
def reading(path: Path | str, form: str) -> Iterator[None]:
    """Refuse a file of some form that cannot be read, whatever error its library raises."""
    try:
        yield
    except RecordingError:
        raise
    except MemoryError:
        raise RecordingError(f"{path}: needs more memory than is free") from None
    except ModuleNotFoundError as error:
        raise RecordingError(
            f"{path}: is {form}, and reading it needs the package {error.name}: install piezobench[formats]"
        ) from None
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file") from None
    except Exception as error:
        *_, (place, _) = traceback.walk_tb(error.__traceback__)
        if place.f_globals["__name__"].startswith("piezo_model.") and isinstance(error, MISTAKES):
            raise
        of_system = getattr(error, "strerror", None)
        why = f"cannot be read: {of_system}" if of_system else f"is {form}, and damaged: {first_line(error)}"
        raise RecordingError(f"{path}: {why}") from None


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    """Name in the file, without characters that cannot be printed; not necessarily unique."""
    unit: str = ""
    """Unit in ASCII; "" if unknown."""
    kind: Kind = "number"
    rows: int | None = None
    """Number of rows, if the format states it."""
    sample_time: float | None = None
    """Sampling period in seconds, if the file states it."""
    start: float | None = None
    """Time of the first row in seconds, if the file states it."""
    nested: bool = False
    """Whether the name is a path, ``group/channel``."""

    @classmethod
    def named(cls, name: str, unit: str = "", **more: Any) -> "Column":
        """A column with a given unit, or else the unit in its name, or in the last part of its path.

        >>> Column.named("Weg [µm]").unit, Column.named("Sollwert", "[Digits]").unit
        ('um', 'Digits')
        """
        name = printable(name)
        last = name.rpartition("/")[2] if more.get("nested") else name
        return cls(name, canonical(unit) or split_unit(last)[1] or printable(unit).strip("[]() "), **more)

    @property
    def stem(self) -> str:
        """The name without its unit, and without its path if its last part has a letter."""
        last = self.name.rpartition("/")[2] if self.nested else self.name
        return split_unit(last if re.search(r"[^\W\d]", last) else self.name.replace("/", " "))[0]


@dataclass(frozen=True)
class Table:
    """An opened file."""

    path: Path | str
    form: str
    """Format and dialect of the file, as a clause of a sentence."""
    columns: tuple[Column, ...]
    """In the order of the file."""
    batches: Callable[[Sequence[int]], Iterable[Sequence[Any]]] = field(repr=False)
    """The columns at some positions, in batches of rows: numbers, datetime64, timedelta64, or clocks as text."""
    where: RowName = field(default=lambda row: f"data row {row + 1}", repr=False)
    repairs: tuple[str, ...] = ()
    """Rows that were dropped, as clauses."""
    clocks: Callable[..., np.ndarray] | None = field(default=None, repr=False)
    """Converts the batches of a column of clocks to times, given the label and the names of rows for error messages."""
    title: str = ""
    """Name of its sheet, or the text above it, by which the user chooses among the tables of a file."""
    rows: int = 0
    """Approximate number of rows, for a choice among several tables."""

    def __post_init__(self) -> None:
        """Refuse more columns than a recording has."""
        if len(self.columns) > MOST_COLUMNS:
            raise RecordingError(
                f"{self.path}: has {len(self.columns)} columns, more than the limit of {MOST_COLUMNS} for a recording"
            )

    @cached_property
    def names(self) -> list[str]:
        """Names of the columns; repeated names have their position added."""
        return distinct([column.name for column in self.columns])

    def heads(self, columns: Sequence[int]) -> dict[int, Vector]:
        """The first values of columns, without missing and absurd ones, by position."""
        heads = self.read(columns, slice(HEAD_ROWS)) if columns else []
        return {k: head[np.abs(head) < ABSURD] for k, head in zip(columns, heads, strict=True)}

    def read(self, columns: Sequence[int], rows: slice = slice(None)) -> list[Vector]:
        """The columns at these positions, shape (rows,).

        Raises
        ------
        RecordingError
            The columns have different lengths, are damaged, or do not fit into free memory.
        """
        if len({self.columns[k].rows for k in columns}) > 1:
            lengths = ", ".join(f"{self.names[k]!r} has {self.columns[k].rows} rows" for k in columns)
            raise RecordingError(f"{self.path}: the columns differ in length: {lengths}")
        first, stop, step = rows.indices(sys.maxsize)
        most = free_memory() / (8 * COPIES * max(len(columns), 1))
        chunks = list[list[Any]]([[] for _ in columns])
        seen = selected = 0
        with reading(self.path, self.form):
            for batch in self.batches(columns):
                begin = first - seen if seen < first else -(seen - first) % step
                part = slice(begin, max(stop - seen, 0), step)
                seen += len(batch[0])
                selected += len(batch[0][part])
                if selected > most:
                    raise RecordingError(
                        f"{self.path}: has more than {selected} rows, too many for the free memory; read part of it "
                        "with --from and --to (seconds), or every tenth row with --decimate 10"
                    )
                for k, values, read in zip(columns, batch, chunks, strict=True):
                    chunk = values[part]
                    read.append(chunk if self.columns[k].kind == "clock" else np.array(chunk, dtype=float))
                if seen >= stop:
                    break
        return [self._joined(k, chunks.pop(0)) for k in columns]

    def _joined(self, k: int, chunks: list[Any]) -> Vector:
        if chunks and self.clocks and self.columns[k].kind == "clock":
            chunks = [self.clocks(chunks, f"{self.path}: column {self.names[k]!r}", self.where)]
        values = np.concatenate(chunks or [np.empty(0)])
        return seconds_since_first(values) if values.dtype.kind in "mM" else values


def seconds_since_first(times: np.ndarray) -> Vector:
    """Seconds since the first time, exact to the unit of the times; NaN for a missing one.

    Seconds since 1970 in double precision would be rounded to 0.2 µs. Times of day may pass midnight.
    """
    seconds, known = np.full(times.shape, np.nan), ~np.isnat(times)
    valid = times[known]
    if valid.dtype.kind == "m":
        midnights = np.cumsum(np.diff(valid, prepend=valid[:1]) < np.timedelta64(-12, "h"))
        valid = valid + midnights * np.timedelta64(1, "D")
    seconds[known] = (valid - valid[:1]) / np.timedelta64(1, "s")
    return seconds


def check_size(path: Path | str, size: float, most: int | None = None) -> None:
    """Refuse values before they are read, by the size in bytes that their file states.

    Examples
    --------
    >>> check_size("stage.bin", -8)
    Traceback (most recent call last):
    piezo_model.recordings.table.RecordingError: stage.bin: its values take -8 bytes; at most 2,147,483,648 are read
    """
    if not (most := most or MOST_BYTES) >= size >= 0:
        raise RecordingError(f"{path}: its values take {size:,.0f} bytes; at most {most:,} are read")


def free_memory() -> float:
    """Available memory in bytes; infinite if the system does not state it."""
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            return 1024.0 * next(float(line.split()[1]) for line in file if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        return np.inf


def distinct(names: Sequence[str]) -> list[str]:
    """Names of columns; repeated names are numbered by their position.

    >>> distinct(["u", "y", "u"])
    ['u (1)', 'y', 'u (3)']
    """
    counts = Counter(names)
    return [f"{name} ({k + 1})" if counts[name] > 1 else name for k, name in enumerate(names)]


def printable(text: str) -> str:
    """A text in one line, without characters that cannot be printed.

    >>> printable("drive\x1a_V")
    'drive_V'
    """
    return "".join(c if c.isprintable() else " " * (c in "\t\r\n") for c in text).strip()


def check_sample_time(label: str, seconds: float) -> None:
    """Refuse a sampling period that no structure can have."""
    least, most = SAMPLE_TIMES
    if not least <= seconds <= most:
        raise RecordingError(f"{label}the sampling period must be from {least:g} to {most:g} s, not {seconds}")


def first_line(error: BaseException) -> str:
    """First line of an error's message, or its type."""
    return printable((str(error).strip().splitlines() or [type(error).__name__])[0]).rstrip(".")
