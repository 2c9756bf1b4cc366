"""HDF5, NeXus and MATLAB 7.3 files: every dataset of numbers is a column, or several, by its path ``group/channel``.

Plain columns are read in slices. The attribute ``units`` (NeXus) or ``unit`` gives the unit, and a scalar dataset or an
attribute with the name of a sampling rate or period gives the period.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.sampling_remark import sample_time_in
from piezo_model.recordings.tables import ArrayTable, ReadOptions, in_memory, parsed

NAME = "an HDF5 file"
SUBPROCESS = True
UNITS = ("Unit", "Units", "unit", "units")
"""Names of the attribute with the unit; the last one present is used."""
MAGIC = b"\x89HDF\r\n\x1a\n"


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file has the signature of HDF5 at one of its possible offsets, and is not a MATLAB file."""
    return not head.startswith(b"MATLAB ") and any(head[at : at + 8] == MAGIC for at in (0, 512, 1024, 2048, 4096))


@dataclass(frozen=True)
class Slices:
    """A column that is read in slices; the file is closed in between, since an open one is locked."""

    path: Path
    dataset: str
    dtype: np.dtype
    size: int
    ndim: int = 1

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, rows: slice) -> NDArray:
        import h5py

        with h5py.File(self.path, "r") as file:
            return np.asarray(file[self.dataset][rows])


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """List the datasets; plain columns are left in the file."""
    import h5py

    datasets: list[Any] = []
    with parsed(path, "HDF5"), h5py.File(path, "r") as file:
        refuse_other_files(path, file)
        file.visititems(lambda name, item: datasets.append(item) if isinstance(item, h5py.Dataset) else None)
        datasets = [item for item in datasets if not item.name.startswith("/#")]  # MATLAB's references
        stated = _stated([file, *(item.parent for item in datasets), *datasets], datasets)
        columns = {
            item.name.lstrip("/"): item
            for item in datasets
            if max(item.shape or (0,)) > 1 and item.ndim <= 2 and (item.dtype.names or item.dtype.kind in "iufb")
        }
        units = {name: _text(item.attrs[key]) for name, item in columns.items() for key in UNITS if key in item.attrs}
        arrays = {
            name: Slices(path, item.name, item.dtype, item.size)
            if item.ndim == 1 and not item.dtype.names
            else item[()]
            for name, item in columns.items()
        }
    return in_memory(path, "HDF5", arrays, units=units, sample_time=stated)


def refuse_other_files(path: Path, file: Any) -> None:
    """Refuse an open HDF5 file that takes values from others: it would show the bytes of any file of this machine."""
    import h5py

    def elsewhere(name: str, item: Any) -> str | None:  # None goes on
        outside = isinstance(item, h5py.Dataset) and (item.external or item.is_virtual)
        return name if outside or isinstance(item, h5py.ExternalLink) else None

    name = file.visititems(elsewhere) or file.visititems_links(elsewhere)
    if name is not None:
        raise RecordingError(f"{path}: takes {name!r} from another file, and only values in the file are read")


def _stated(holders: list[Any], datasets: list[Any]) -> float | None:
    """The sampling period, if attributes and scalars state exactly one."""
    scalars = [
        (key, value)
        for holder in holders
        for key, value in holder.attrs.items()
        if np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"
    ] + [
        (f"{item.name.rpartition('/')[2]} [{_text(item.attrs.get('units', ''))}]", np.ravel(item[()])[0])
        for item in datasets
        if item.size == 1 and item.dtype.kind in "iuf"
    ]
    return sample_time_in(f"{name} = {float(value)!r}" for name, value in scalars)


def _text(value: Any) -> str:
    value = np.ravel(value)[0] if np.ndim(value) else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
