"""NumPy's ``.npy``, mapped into memory and read in slices, and ``.npz``."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from piezo_model.recordings.sampling_remark import sample_time_of
from piezo_model.recordings.tables import ChannelTable, Reading, in_memory, parsed

NAME = "a NumPy file"
ORDER = 40


def recognises(path: Path, head: bytes) -> bool:
    """Whether it is an array, or an archive of arrays."""
    if head.startswith(b"\x93NUMPY"):
        return True
    return head.startswith(b"PK\x03\x04") and zipfile.is_zipfile(path) and _is_archive(path)


def open_table(path: Path, reading: Reading) -> ChannelTable:
    """Open an array of rows and columns, a structured array, or an archive of them."""
    with parsed(path, "NumPy"):
        if zipfile.is_zipfile(path):
            with np.load(path, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        else:
            arrays = {"": np.load(path, mmap_mode="r", allow_pickle=False)}
    stated = {period for name, array in arrays.items() if array.size == 1 and array.dtype.kind in "iuf"
              and (period := sample_time_of(name, float(array.ravel()[0]))) is not None}
    return in_memory(path, "NumPy", arrays, sample_time=stated.pop() if len(stated) == 1 else None)


def _is_archive(path: Path) -> bool:
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith(".npy") for name in archive.namelist())
