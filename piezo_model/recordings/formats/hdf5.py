"""HDF5, NeXus and MATLAB 7.3 files: every dataset of numbers is a column, or several, by its path ``group/channel``.

Datasets are read in slices. Units stand in the attribute ``units`` (NeXus) or ``unit``; a scalar dataset or an
attribute whose name is that of a sampling rate or period gives the period.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.sampling_remark import only, sample_time_of
from piezo_model.recordings.tables import Channel, ChannelTable, Column, Reading, parsed

NAME = "an HDF5 file"
ORDER = 30
APART = True
MAGIC = b"\x89HDF\r\n\x1a\n"


def recognises(path: Path, head: bytes) -> bool:
    """Whether the signature of HDF5 stands at the start or at one of the places where it may."""
    return any(head[at : at + 8] == MAGIC for at in (0, 512, 1024, 2048, 4096))


@dataclass(frozen=True)
class Slice:
    """Rows of one column of a dataset."""

    path: Path
    dataset: str
    axis: int
    """Along which the rows run."""
    at: int
    """Which of the columns."""
    part: str | None = None
    """Field of a compound dataset."""

    def __call__(self, start: int, stop: int) -> NDArray:
        """Values from one row to before another."""
        import h5py

        with h5py.File(self.path, "r") as file:
            data = file[self.dataset]
            data = data.fields(self.part) if self.part else data
            if len(file[self.dataset].shape) == 1:
                return np.asarray(data[start:stop])
            return np.asarray(data[start:stop, self.at] if self.axis == 0 else data[self.at, start:stop])


def open_table(path: Path, reading: Reading) -> ChannelTable:
    """List the datasets."""
    import h5py

    datasets: list[Any] = []
    with parsed(path, "HDF5"), h5py.File(path, "r") as file:
        file.visititems(lambda name, item: datasets.append(item) if isinstance(item, h5py.Dataset) else None)
        datasets = [item for item in datasets if not item.name.startswith("/#")]  # MATLAB's references
        stated = _stated([file, *(item.parent for item in datasets), *datasets], datasets)
        channels = [Channel(column, read) for item in datasets for column, read in _columns(path, item, stated)]
    return ChannelTable(path, "HDF5", channels)


def _columns(path: Path, item: Any, stated: float | None) -> Iterator[tuple[Column, Slice]]:
    name: str = item.name.lstrip("/")
    shape: tuple[int, ...] = item.shape or ()
    rows = max(shape, default=0)
    if rows < 2 or len(shape) > 2:
        return
    unit = next((_text(item.attrs[key]) for key in ("units", "unit", "Units", "Unit") if key in item.attrs), "")
    if item.dtype.names:
        for part in item.dtype.names:
            if item.dtype[part].kind in "iufb" and not item.dtype[part].shape and len(shape) == 1:
                yield Column.of_path(f"{name}/{part}", "", rows, stated), Slice(path, item.name, 0, 0, part)
    elif item.dtype.kind in "iufb":
        axis = 0 if len(shape) == 1 or shape[0] >= shape[1] else 1
        count = 1 if len(shape) == 1 else min(shape)
        for k in range(count):
            label = name if count == 1 else f"{name}/{k + 1}"
            yield Column.of_path(label, unit, rows, stated), Slice(path, item.name, axis, k)


def _stated(holders: list[Any], datasets: list[Any]) -> float | None:
    """The sampling period, where attributes and scalars state exactly one."""
    by_attribute = (
        sample_time_of(key, float(value))
        for holder in holders
        for key, value in holder.attrs.items()
        if np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"
    )
    by_scalar = (
        sample_time_of(item.name.rpartition("/")[2], float(np.ravel(item[()])[0]), _text(item.attrs.get("units", "")))
        for item in datasets
        if item.size == 1 and item.dtype.kind in "iuf"
    )
    return only([*by_attribute, *by_scalar])


def _text(value: Any) -> str:
    value = np.ravel(value)[0] if np.ndim(value) else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
