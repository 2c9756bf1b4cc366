"""Runs a reader whose format is parsed by a C library in a child process with a memory and a time limit: a file that
breaks its parser breaks nothing else.

One child serves a process, started by the first such file. A file with more values than ``AT_ONCE`` is listed first,
and then only the arrays that are wanted are sent.
"""

import atexit
import os
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from piezo_model.child_process import Child, LateError, LostError, limit_memory
from piezo_model.recordings.array_table import Arrays, table_of
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.table import RecordingError, Table

MEMORY_MB = 4096
"""Memory limit of the child."""
LEAST_S, BYTES_PER_S = 60.0, 5e6
"""Time limit of a file, and the rate that extends it for large ones."""
AT_ONCE = 40_000_000
Reader = Callable[[Path, ReadOptions], Arrays]
_lock = Lock()
_limit_memory = cache(limit_memory)  # once in a process


class _Unread(NamedTuple):
    """Shape and type of an array that stays in the child."""

    shape: tuple[int, ...]
    dtype: np.dtype


def open_isolated(reader: Reader, path: Path, options: ReadOptions) -> Table:
    """The table of a reader's arrays; its exceptions are raised here, and a child that ends is a RecordingError."""
    found = call(reader, path, options)
    if not any(isinstance(array, _Unread) for array in found.arrays.values()):
        return table_of(path, found)
    arrays = {name: np.broadcast_to(np.empty((), array.dtype), array.shape) for name, array in found.arrays.items()}
    return table_of(path, found._replace(arrays=arrays), lambda names: call(reader, path, options, names).arrays)


def call(
    reader: Callable[..., Any],
    path: Path,
    options: ReadOptions,
    names: Sequence[str] | None = None,
    at_once: int = AT_ONCE,
) -> Any:
    """What a reader returns in the child: of an `Arrays` these arrays, or those of all names if they are not many."""
    limit_s = LEAST_S + path.stat().st_size / BYTES_PER_S
    try:
        with _lock:
            answer = _child(os.getpid()).call(limit_s, _answer, reader, path.absolute(), options, names, at_once)
    except LateError:
        raise RecordingError(f"{path}: takes longer than {limit_s:.0f} s to be read") from None
    except LostError as error:
        raise RecordingError(f"{path}: is damaged, the process that read it ended with {error}") from None
    if isinstance(answer, Exception):
        raise answer
    return answer


@cache
def _child(process: int) -> Child:
    """The child of this process; a fork has its own."""
    child = Child()
    atexit.register(child.close)
    return child


def _answer(
    reader: Callable[..., Any], path: Path, options: ReadOptions, names: Sequence[str] | None, at_once: int
) -> Any:
    """In the child: what the reader has found, or the exception."""
    _limit_memory(MEMORY_MB)
    try:
        found = reader(path, options)
        if not isinstance(found, Arrays):
            return found
        listed = names is None and sum(array.size for array in found.arrays.values()) > at_once
        chosen = {name: found.arrays[name] for name in names or found.arrays}
        return found._replace(
            arrays={name: _Unread(each.shape, each.dtype) if listed else each[()] for name, each in chosen.items()}
        )
    except MemoryError:
        return RecordingError(f"{path}: takes more than {MEMORY_MB} MB to be read")
    except Exception as error:
        return error
