"""NumPy's ``.npz``, an archive of arrays."""

import zipfile
from pathlib import Path

import numpy as np

from piezo_model.recordings.sampling_remark import sample_time_in_scalars
from piezo_model.recordings.tables import ArrayTable, ReadOptions, in_memory, parsed

NAME = "an archive of NumPy"
SUBPROCESS = True


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file is an archive of arrays."""
    if not (head.startswith(b"PK\x03\x04") and zipfile.is_zipfile(path)):
        return False
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith(".npy") for name in archive.namelist())


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """Read every array."""
    with parsed(path, "NumPy"), np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return in_memory(path, "NumPy", arrays, sample_time=sample_time_in_scalars(arrays))
