"""The arithmetic of model, data basis and compensator in C99, and the extension module through which Python calls it.

The headers of this folder say what each function does, ``solvers/core/README.md`` how the whole is built and extended.
"""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import solvers.core

bindings: Any = solvers.core.load(Path(__file__).parents[1], solvers.core.bindings.processor_level())


class State:
    """A state of the core with views of its vectors, ``state["play"]``; a copy, deep or pickled, is independent.

    Parameters
    ----------
    size : int
        Bytes.
    setup : callable
        Makes the block a state and returns where each vector begins, in bytes, and how long it is.
    """

    def __init__(self, size: int, setup: Callable[[NDArray[np.uint8]], Mapping[str, tuple[int, int]]]) -> None:
        self.block = solvers.core.block(size)
        self.places = setup(self.block)
        self._views = solvers.core.parts(self.block, self.places)
        self._in_use = threading.Lock()

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._views[name]

    def whole(self, name: str) -> NDArray[np.int64]:
        """A part that holds whole numbers."""
        return self._views[name].view(np.int64)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep a second thread out with a RuntimeError: two that change one state leave it wrong, and crash where it
        grows meanwhile."""
        if not self._in_use.acquire(blocking=False):
            raise RuntimeError("it is in use by another thread; give each thread one of its own")
        try:
            yield
        finally:
            self._in_use.release()

    def restore(self, data: NDArray[np.uint8], take: Callable[[NDArray[np.uint8], NDArray[np.uint8]], None]) -> None:
        """Become the state of these bytes, by the core's function that refuses (ValueError) what cannot be."""
        if data.dtype != np.uint8 or data.size != self.block.size:
            raise ValueError("the state of the core is that of another structure or size")
        aligned = solvers.core.block(data.size)
        aligned[:] = data
        take(self.block, aligned)

    def __reduce__(self) -> tuple[Any, ...]:
        return _copied, (self.block.tobytes(), self.places)


def _copied(data: bytes, places: Mapping[str, tuple[int, int]]) -> State:
    def fill(block: NDArray[np.uint8]) -> Mapping[str, tuple[int, int]]:
        block[:] = np.frombuffer(data, np.uint8)
        return places

    return State(len(data), fill)
