"""A table of named arrays as in scientific formats: any lengths, matrices, fields, batches of recordings."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezo_model.recordings.table import (
    KINDS,
    MOST_COLUMNS,
    Column,
    RecordingError,
    Table,
    check_sample_time,
    check_size,
    printable,
)

MOST_AXES = 3
"""Most columns of two matrices that are axes of one stage (more are recordings), and most unread arrays that are
named."""


class Arrays(NamedTuple):
    """What a reader of a format returns."""

    form: str
    """Name of the format, as a clause."""
    arrays: Mapping[str, Any]
    """By name or path; with a shape and a type. Arrays that are not in memory are read by ``[()]`` on request."""
    units: Mapping[str, str] = {}
    periods: Mapping[str, float | None] | float | None = None
    """Sampling period in seconds by name, or one for all."""
    starts: Mapping[str, float] = {}
    """Time of the first sample in seconds by name."""
    nested: bool = True
    """True if the names are paths."""


def table_of(path: Path | str, contents: Arrays) -> Table:
    """The table of what a reader returns.

    A matrix becomes columns ``name/1``, ``name/2``, …; matrices of one shape, with a time for each of their rows or
    columns, are a batch of recordings, which are concatenated.
    """

    def read(names: Iterable[str]) -> dict[str, Any]:
        chosen = {name: arrays[name] for name in names}
        check_size(path, sum(a.size * a.dtype.itemsize for a in chosen.values() if not isinstance(a, np.ndarray)))
        return {name: array[()] for name, array in chosen.items()}

    arrays, form = contents.arrays, contents.form
    if batch := _batch_of(arrays):
        shape, in_rows = batch
        arrays = {name: _joined(np.squeeze(array), shape, in_rows) for name, array in read(arrays).items()}
        form = f"{form}, a batch of {shape[not in_rows]} recordings of {shape[in_rows]} samples"
    columns: dict[tuple[str, str], Column] = {}
    for name, array in arrays.items():
        period = contents.periods.get(name) if isinstance(contents.periods, Mapping) else contents.periods
        if period is not None:
            check_sample_time(f"{path}: ", period)
        if not isinstance(array, np.ndarray):  # only shape and type are known
            array = np.broadcast_to(np.empty((), array.dtype), array.shape)
        for label, values in islice(_columns(name, array), MOST_COLUMNS + 1):
            columns[name, label] = Column.named(
                label,
                contents.units.get(name, ""),
                kind=KINDS[values.dtype.kind],
                rows=len(values),
                sample_time=period,
                start=contents.starts.get(name),
                nested=contents.nested,
            )
    sources = [*columns]
    unread = [
        f"{printable(name or 'array')!r} ({' x '.join(map(str, array.shape)) or 'one value'}, {array.dtype.name})"
        for name, array in arrays.items()
        if all(name != of for of, _ in sources) and (array.ndim > 2 or array.dtype.kind == "c")
    ][:MOST_AXES]
    if not columns:
        raise RecordingError(
            f"{path}: is {form} without a column of two or more numbers"
            + f"; it holds {', '.join(unread)}; save real arrays of one or two dimensions" * bool(unread)
        )
    form += f", without {', '.join(unread)}" * bool(unread)

    def batches(at: Sequence[int]) -> Iterator[Sequence[Any]]:
        chosen = read(sources[k][0] for k in at)
        values = {(name, label): values for name in chosen for label, values in _columns(name, chosen[name])}
        yield [values[sources[k]] for k in at]

    return Table(path, form, tuple(columns.values()), batches)


def _batch_of(arrays: Mapping[str, Any]) -> tuple[tuple[int, ...], bool] | None:
    """The shape of a batch among some arrays, and whether its rows (or else columns) are the recordings; None if there
    are not two matrices of one shape, and a vector of times for one of its axes."""
    shapes = [tuple(k for k in a.shape if k != 1) for a in arrays.values() if a.dtype.kind in "iuf"]
    lengths = {shape[0] for shape in shapes if len(shape) == 1}
    common = Counter(shape for shape in shapes if len(shape) == 2).most_common(1)
    if not common or common[0][1] < 2:
        return None
    shape, _ = common[0]
    if shape[0] == shape[1] or lengths.isdisjoint(shape):
        return None
    return (shape, in_rows) if (in_rows := shape[1] in lengths) or shape[1] > MOST_AXES else None


def _joined(array: np.ndarray, shape: tuple[int, ...], in_rows: bool) -> np.ndarray:
    """The concatenated recordings of a batch, or their common times repeated for each; other arrays as they are."""
    if array.shape == shape:
        return (array if in_rows else array.T).ravel()
    return np.tile(array, shape[not in_rows]) if array.shape == shape[in_rows : in_rows + 1] else array


def _columns(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Names and columns of the numbers in an array; none if it holds no numbers."""
    flat = np.squeeze(array) if array.ndim > 1 and array.size > 1 else array
    if array.dtype.names:
        for field in array.dtype.names:
            yield from _columns(f"{name}/{field}" if name else field, array[field])
    elif array.dtype.kind in KINDS and flat.ndim == 1 and array.size > 1:
        yield name or "column 1", flat
    elif array.dtype.kind in KINDS and flat.ndim == 2:
        for k, column in enumerate(flat.T if flat.shape[0] >= flat.shape[1] else flat, start=1):
            yield f"{name}/{k}" if name else f"column {k}", column
