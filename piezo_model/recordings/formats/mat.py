"""MATLAB files: versions 4 to 7 by scipy, 7.3 (which is HDF5) by pymatreader.

A struct with fields ``Name`` (or ``label``) and ``Data`` (or ``values``), as of Simulink and dSPACE, is a channel of
that name. Any other variable is a column named by its path; a matrix gives a column for each of its columns, and a cell
array one for each cell.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.formats.hdf5 import refuse_other_files
from piezo_model.recordings.sampling_remark import sample_time_in_scalars
from piezo_model.recordings.tables import ArrayTable, ReadOptions, in_memory, parsed

NAME = "a MATLAB file"
SUBPROCESS = True
NAMES, VALUES, UNITS = ("name", "label", "title"), ("data", "values", "value", "y"), ("unit", "units")


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts with MATLAB's text; version 4 is recognised by its suffix and first number."""
    version_4 = path.suffix.lower() == ".mat" and head[:4] in (b"\0\0\0\0", b"\x0a\0\0\0", b"\0\0\x03\xe8")
    return head.startswith(b"MATLAB ") or version_4


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """Read every variable."""
    with path.open("rb") as file:
        modern = file.read(10) == b"MATLAB 7.3"
    if modern:
        import h5py
        from pymatreader import read_mat as read

        with parsed(path, "MATLAB 7.3"), h5py.File(path, "r") as file:
            refuse_other_files(path, file)
    else:
        from scipy.io import loadmat

        read = partial(loadmat, simplify_cells=True)
    with parsed(path, "MATLAB"):
        variables = read(str(path))
    units: dict[str, str] = {}
    arrays = {name: array for name, array in _arrays("", variables, units) if name is not None}
    return in_memory(
        path,
        "MATLAB 7.3" if modern else "MATLAB",
        {name: array for name, array in arrays.items() if array.size > 1},
        units=units,
        sample_time=sample_time_in_scalars(arrays),
    )


def _arrays(path: str, value: Any, units: dict[str, str]) -> Iterator[tuple[str, NDArray]]:
    """Paths and arrays of all numbers in a value; their units are added to ``units``."""
    if isinstance(value, dict):
        plain = {str(key).lower(): item for key, item in value.items()}
        name, data, unit = (next((plain[key] for key in keys if key in plain), None) for keys in (NAMES, VALUES, UNITS))
        if isinstance(name, str) and name and data is not None:
            label = f"{path}/{name}".lstrip("/")
            units[label] = unit if isinstance(unit, str) else ""
            yield from _arrays(label, data, units)
            value = {key: item for key, item in value.items() if str(key).lower() not in (*NAMES, *VALUES, *UNITS)}
        for key, item in value.items():
            if not str(key).startswith("__"):
                yield from _arrays(f"{path}/{key}".lstrip("/"), item, units)
    elif isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
        for k, item in enumerate(np.ravel(value) if isinstance(value, np.ndarray) else value, start=1):
            named = isinstance(item, dict) and any(
                item[key] and isinstance(item[key], str) for key in item if key.lower() in NAMES
            )
            yield from _arrays(path if named else f"{path}/{k}", item, units)
    elif np.asarray(value).dtype.kind in "iufb":
        yield path, np.asarray(value)
