"""NumPy's ``.npy``, mapped into memory and read in slices."""

from pathlib import Path

import numpy as np

from piezo_model.recordings.tables import ArrayTable, ReadOptions, in_memory, parsed

NAME = "a NumPy file"


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file is an array."""
    return head.startswith(b"\x93NUMPY")


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """Open an array of rows and columns, or a structured array."""
    with parsed(path, "NumPy"):
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    return in_memory(path, "NumPy", {"": array})
