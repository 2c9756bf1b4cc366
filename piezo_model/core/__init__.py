"""Model, data basis, compensator and learner in C99, and the extension module through which Python calls them.

The headers of this folder document the functions, ``solvers/core/README.md`` how the core is built and extended.
"""

import copy
import functools
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

import solvers.core

bindings: Any = solvers.core.load(Path(__file__).parents[1], solvers.core.bindings.processor_level())


class State:
    """A state of the core with views of its vectors, ``state["play"]``; all copies are independent.

    A copy in the making counts as use (:meth:`exclusive`). Whoever owns a state stores no view of it, since a copy of
    the owner would have a view of other memory.

    Parameters
    ----------
    size : int
        Bytes.
    setup : callable
        Initialises the block and returns the offset of each vector in bytes, and its length.
    """

    def __init__(self, size: int, setup: Callable[[NDArray[np.uint8]], Mapping[str, tuple[int, int]]]) -> None:
        self.block = solvers.core.block(size)
        self.offsets = setup(self.block)
        self._views = solvers.core.field_views(self.block, self.offsets)
        self._in_use = threading.RLock()

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._views[name]

    def as_int64(self, name: str) -> NDArray[np.int64]:
        """A part that holds integers."""
        return self._views[name].view(np.int64)

    def record(self, name: str, layout: "np.dtype[np.void]") -> np.void:
        """A part that holds a struct, as a view with named fields."""
        record: np.void = self._views[name].view(layout)[0]
        return record

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Refuse a second thread with a RuntimeError: two threads would corrupt the state."""
        if not self._in_use.acquire(blocking=False):
            raise RuntimeError("it is in use by another thread; give each thread one of its own")
        try:
            yield
        finally:
            self._in_use.release()

    def restore(self, data: NDArray[np.uint8], take: Callable[[NDArray[np.uint8], NDArray[np.uint8]], None]) -> None:
        """Restore a state from its bytes by a function of the core that checks them (ValueError)."""
        if data.dtype != np.uint8 or data.size != self.block.size:
            raise ValueError("the state of the core is that of another structure or size")
        aligned = solvers.core.block(data.size)
        aligned[:] = data
        take(self.block, aligned)

    def __reduce__(self) -> tuple[Any, ...]:
        with self.exclusive():
            return _copied, (self.block.tobytes(), self.offsets)


def _copied(data: bytes, offsets: Mapping[str, tuple[int, int]]) -> State:
    def fill(block: NDArray[np.uint8]) -> Mapping[str, tuple[int, int]]:
        block[:] = np.frombuffer(data, np.uint8)
        return offsets

    return State(len(data), fill)


Method = TypeVar("Method", bound=Callable[..., Any])


def exclusively(method: Method) -> Method:
    """A method during which a second thread is refused, by the state ``_core`` of the object."""

    @functools.wraps(method)
    def alone(self: Any, *args: Any, **kwargs: Any) -> Any:
        with self._core.exclusive():
            return method(self, *args, **kwargs)

    return cast(Method, alone)


class Stateful:
    """Base of the objects that change with every sample: a shallow copy would share the state, so each copy is deep."""

    def __copy__(self) -> Self:
        return copy.deepcopy(self)


class Immutable:
    """Base of frozen dataclasses whose arrays are read-only: a copy is made of the fields, like the original."""

    def to_dict(self) -> dict[str, Any]:
        """Fields as JSON types."""
        values = asdict(self).items()  # type: ignore[call-overload]
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]
