"""Reads files whose formats are parsed by C libraries in a child process: a parser that fails cannot affect the caller.

The child keeps the last opened file; each reading process has one child, started by the first such file.
"""

import atexit
import os
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.child_process import Child, LateError, LostError, limit_memory
from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.tables import ArrayTable, ReadOptions

MEMORY_MB = 4096
"""Memory limit of the child."""
LEAST_S, BYTES_PER_S = 60.0, 5e6
"""Time limit of a request, and the rate that extends it for large files."""
_lock = Lock()
_limit_memory = cache(limit_memory)  # once in a process
_opened: dict[Any, ArrayTable] = {}
"""In the child: the last opened file."""


@dataclass(frozen=True)
class File:
    """A file as it was when it was opened, and the module of its format."""

    path: Path
    module: str
    options: ReadOptions
    size: int
    changed_ns: int


@dataclass(frozen=True)
class Rows:
    """An array in the child, read by slices."""

    file: File
    at: int

    def __getitem__(self, rows: slice) -> NDArray:
        """Some of its values."""
        values: NDArray = _request(self.file, self.at, rows)
        return values


def open_table(module: ModuleType, path: Path, options: ReadOptions) -> ArrayTable:
    """List the columns; the errors are those of :func:`piezo_model.recordings.opening.open_table`."""
    stat = path.stat()
    file = File(path.absolute(), module.__name__, options, stat.st_size, stat.st_mtime_ns)
    form, columns = _request(file)
    return ArrayTable(path, form, columns, [Rows(file, k) for k in range(len(columns))])


def _request(file: File, at: int | None = None, rows: slice = slice(None)) -> Any:
    """The child's answer. Its exceptions are raised here; a child that ends is a RecordingError."""
    limit_s = LEAST_S + file.size / BYTES_PER_S
    try:
        with _lock:
            answer = _child(os.getpid()).call(limit_s, _answer, file, at, rows)
    except LateError:
        raise RecordingError(f"{file.path}: takes longer than {limit_s:.0f} s to be read") from None
    except LostError as error:
        raise RecordingError(f"{file.path}: is damaged, the process that read it ended with {error}") from None
    if isinstance(answer, Exception):
        raise answer
    return answer


@cache
def _child(process: int) -> Child:
    """The child of this process; a fork has its own."""
    child = Child()
    atexit.register(child.close)
    return child


def _answer(file: File, at: int | None, rows: slice) -> Any:
    """In the child: form and columns of a table, or rows of one of its columns, or the exception."""
    try:
        if file not in _opened:
            _opened.clear()  # before the next one needs the memory
            _limit_memory(MEMORY_MB)
            _opened[file] = import_module(file.module).open_table(file.path, file.options)
        table = _opened[file]
        return (table.form, table.columns) if at is None else np.asarray(table.arrays[at][rows])
    except MemoryError:
        return RecordingError(f"{file.path}: takes more than {MEMORY_MB} MB to be read")
    except Exception as error:
        return error
