"""A table of named arrays, as scientific formats hold them: any lengths, matrices, fields, batches of recordings."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezo_model.recordings.roles import TIME_WORDS
from piezo_model.recordings.table import (
    KINDS,
    MOST_COLUMNS,
    Column,
    RecordingError,
    Table,
    check_sample_time,
    check_size,
)

MOST_AXES = 3
"""Most columns of two matrices that are axes of one stage; more of them are recordings."""


class Arrays(NamedTuple):
    """What a reader of a format returns."""

    form: str
    """Name of the format, as a clause."""
    arrays: Mapping[str, Any]
    """By name or path; they have a shape and a type. Those that are not in memory are read by ``[()]`` when they are
    asked for."""
    units: Mapping[str, str] = {}
    periods: Mapping[str, float | None] | float | None = None
    """Sampling period in seconds by name, or one for all."""
    nested: bool = True
    """Whether the names are paths."""


def table_of(path: Path, found: Arrays) -> Table:
    """A table of what a reader has found.

    A matrix becomes columns ``name/1``, ``name/2``, …; matrices of one shape, with a time for each of their rows or
    columns, are a batch of recordings, which follow each other.
    """

    def read(names: Iterable[str]) -> dict[str, Any]:
        arrays = {name: found.arrays[name] for name in names}
        check_size(path, sum(a.size * a.dtype.itemsize for a in arrays.values() if not isinstance(a, np.ndarray)))
        return {name: array[()] for name, array in arrays.items()}

    arrays = {  # of those that are not in memory only shape and type
        name: array if isinstance(array, np.ndarray) else np.broadcast_to(np.empty((), array.dtype), array.shape)
        for name, array in found.arrays.items()
    }
    batch, form = _batch_of(arrays, read), found.form
    if batch is not None:
        arrays = read(arrays)
        form = f"{form}, a batch of {batch.many} recordings of {batch.length} samples"
    columns, places = [], []
    for name, array in arrays.items():
        period = found.periods.get(name) if isinstance(found.periods, Mapping) else found.periods
        if period is not None:
            check_sample_time(f"{path}: ", period)
        for label, values in _columns(name, array, batch):
            kind = KINDS[values.dtype.kind]
            more: dict[str, Any] = {"kind": kind, "rows": len(values), "sample_time": period, "nested": found.nested}
            columns.append(Column.named(label, found.units.get(name, ""), **more))
            places.append((name, label))
            if len(columns) > MOST_COLUMNS:
                raise RecordingError(f"{path}: has more than {MOST_COLUMNS} columns, and no recording has")
    if not columns:
        raise RecordingError(f"{path}: is {found.form} without a column of numbers")

    def batches(at: Sequence[int]) -> Iterator[Sequence[Any]]:
        names = [places[k][0] for k in at]
        arrays = read(names)
        values = {(name, label): values for name in names for label, values in _columns(name, arrays[name], batch)}
        yield [values[places[k]] for k in at]

    return Table(path, form, tuple(columns), batches)


class _Batch(NamedTuple):
    """Matrices with one recording in each row, or in each column."""

    shape: tuple[int, ...]
    in_rows: bool

    @property
    def length(self) -> int:
        """Samples of each recording."""
        return self.shape[self.in_rows]

    @property
    def many(self) -> int:
        """Number of recordings."""
        return self.shape[not self.in_rows]

    def column(self, array: Any) -> Any:
        """All recordings of a matrix after each other, or their common times as often."""
        values = array if self.in_rows or array.ndim == 1 else array.T
        return np.tile(values, self.many) if array.ndim == 1 else values.ravel()


def _batch_of(arrays: Mapping[str, Any], read: Callable[[Sequence[str]], dict[str, Any]]) -> _Batch | None:
    """The batch among some arrays: at least two matrices of one shape, and times for one of its axes in a vector or in
    a third such matrix."""
    shapes = {name: np.squeeze(array).shape for name, array in arrays.items() if array.dtype.kind in "iuf"}
    lengths = {shape[0] for shape in shapes.values() if len(shape) == 1}
    common = Counter(shape for shape in shapes.values() if len(shape) == 2).most_common(1)
    if not common or common[0][1] < 2:
        return None
    shape, many = common[0]
    clocks = [name for name in shapes if shapes[name] == shape and name.rpartition("/")[2].lower() in TIME_WORDS]
    if clocks and many > 2:
        times = np.squeeze(read(clocks[:1])[clocks[0]])
        in_rows = bool((np.diff(times, axis=1) > 0.0).all())
        return _Batch(shape, in_rows) if in_rows or (np.diff(times, axis=0) > 0.0).all() else None
    if shape[0] == shape[1] or lengths.isdisjoint(shape):
        return None
    return _Batch(shape, in_rows) if (in_rows := shape[1] in lengths) or shape[1] > MOST_AXES else None


def _columns(name: str, array: Any, batch: _Batch | None) -> Iterator[tuple[str, np.ndarray]]:
    """Names and columns of the numbers in an array; none if it holds no numbers."""
    flat = np.squeeze(array) if array.ndim > 1 and array.size > 1 else array
    if array.dtype.names:
        for part in array.dtype.names:
            yield from _columns(f"{name}/{part}" if name else part, array[part], batch)
    elif batch and (flat.shape == batch.shape or flat.shape == (batch.length,)):
        yield name, batch.column(flat)
    elif array.dtype.kind in KINDS and flat.ndim == 1 and array.size > 1:
        yield name or "column 1", flat
    elif array.dtype.kind in KINDS and flat.ndim == 2:
        long = flat if flat.shape[0] >= flat.shape[1] else flat.T
        for k in range(long.shape[1]):
            yield f"{name}/{k + 1}" if name else f"column {k + 1}", long[:, k]
