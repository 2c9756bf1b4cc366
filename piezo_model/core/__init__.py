"""The arithmetic of model, data basis and compensator in C99, and the extension module through which Python calls it.

The headers of this folder say what each function does, ``solvers/core/README.md`` how the whole is built and extended.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import solvers.core

face: Any = solvers.core.load(Path(__file__).parents[1], solvers.core.face.processor_level())


def aligned(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A copy of bytes from a cache line on, as the core wants them."""
    copied = solvers.core.block(data.size)
    copied[:] = data
    return copied


HEAD = 32
"""Bytes of a state that say what it is: kind, sizes, shape (``ShapedHead`` of ``shape.h``)."""


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
        self._views = {name: self.block[at:at + 8 * length].view(np.float64) for name, (at, length) in self.places.items()}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._views[name]

    def whole(self, name: str) -> NDArray[np.int64]:
        """A part that holds whole numbers."""
        return self._views[name].view(np.int64)

    def restore(self, block: NDArray[np.uint8]) -> None:
        """Become what a block of the same kind and size was; ValueError for another one, and nothing is changed."""
        if not (isinstance(block, np.ndarray) and block.dtype == np.uint8 and block.shape == self.block.shape
                and np.array_equal(block[:HEAD], self.block[:HEAD])):
            raise ValueError("the state of the core is that of another structure")
        self.block[:] = block

    def __reduce__(self) -> tuple[Any, ...]:
        return _copied, (self.block.tobytes(), self.places)


def _copied(data: bytes, places: Mapping[str, tuple[int, int]]) -> State:
    def fill(block: NDArray[np.uint8]) -> Mapping[str, tuple[int, int]]:
        block[:] = np.frombuffer(data, np.uint8)
        return places

    return State(len(data), fill)
