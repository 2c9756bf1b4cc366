"""Files whose formats are parsed by libraries in C are read in a child process: a parser that fails cannot affect
the caller.

The child keeps the file that it opened last; there is one for each process that reads, started by the first such file.
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
"""That a file may take to be read."""
LEAST_S, BYTES_PER_S = 60.0, 5e6
"""Time that a question may take, and how fast a file is read at least."""
_turn = Lock()
_limit_memory = cache(limit_memory)  # once in a process
_kept: dict[Any, ArrayTable] = {}
"""In the child: the file that it opened last."""


@dataclass(frozen=True)
class File:
    """A file as it was when it was opened, and the module of its format."""

    path: Path
    module: str
    reading: ReadOptions
    size: int
    changed_ns: int


@dataclass(frozen=True)
class Rows:
    """An array in the child, read by slices."""

    file: File
    at: int

    def __getitem__(self, rows: slice) -> NDArray:
        """Some of its values."""
        values: NDArray = _ask(self.file, self.at, rows)
        return values


def open_table(module: ModuleType, path: Path, reading: ReadOptions) -> ArrayTable:
    """List the columns; the errors are those of :func:`piezo_model.recordings.opening.open_table`."""
    found = path.stat()
    file = File(path.absolute(), module.__name__, reading, found.st_size, found.st_mtime_ns)
    form, columns = _ask(file)
    return ArrayTable(path, form, columns, [Rows(file, k) for k in range(len(columns))])


def _ask(file: File, *rows: Any) -> Any:
    """The child's answer; what it raised is raised here, and how it ended is said in a sentence."""
    limit_s = LEAST_S + file.size / BYTES_PER_S
    try:
        with _turn:
            found = _child(os.getpid()).call(limit_s, _answer, file, *rows)
    except LateError:
        raise RecordingError(f"{file.path}: takes longer than {limit_s:.0f} s to be read") from None
    except LostError as error:
        raise RecordingError(f"{file.path}: is damaged, the process that read it ended with {error}") from None
    if isinstance(found, Exception):
        raise found
    return found


@cache
def _child(process: int) -> Child:
    """The child of a process, which a fork of it does not share."""
    child = Child()
    atexit.register(child.close)
    return child


def _answer(file: File, at: int | None = None, rows: slice = slice(None)) -> Any:
    """In the child: form and columns of a table, rows of one of its columns, or what went wrong."""
    try:
        if file not in _kept:
            _kept.clear()  # before the next one takes its memory
            _limit_memory(MEMORY_MB)
            _kept[file] = import_module(file.module).open_table(file.path, file.reading)
        table = _kept[file]
        return (table.form, table.columns) if at is None else np.asarray(table.arrays[at][rows])
    except MemoryError:
        return RecordingError(f"{file.path}: takes more than {MEMORY_MB} MB to be read")
    except Exception as error:
        return error
