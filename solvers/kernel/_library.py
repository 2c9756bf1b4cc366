"""Libraries in the compiled timed loop, called by their C functions.

``<name>.c`` of this folder has the two functions of the loop, ``update`` and ``solve``, and only these are timed;
Python calls them too. Python does the set-up and reads the results through ctypes. Arguments and structures of a
library belong to one version, so other versions are refused.
"""

import ctypes
import importlib.metadata
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.adapter import LibrarySolver
from solvers.arrays import address
from solvers.core import bindings
from solvers.protocol import Lane, Matrix, Vector

CORE = ctypes.CDLL(bindings.__file__)
"""The library of the core, for symbols that its C files export."""
Function = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


class Loop(ctypes.Structure):
    """``Library`` of ``library.h``."""

    _fields_ = (("update", Function), ("solve", Function))


def open_library(distribution: str, version: str, library: Path, names: tuple[str, ...]) -> ctypes.CDLL:
    """The library of an installed package.

    Raises
    ------
    ImportError
        Another version is installed, or the library lacks one of the functions.
    """
    if (installed := importlib.metadata.version(distribution)) != version:
        raise ImportError(
            f"the C interface of {distribution} is supported in version {version}, but {installed} is installed"
        )
    try:
        opened_library = ctypes.CDLL(str(library))
        for name in names:
            getattr(opened_library, name)
    except (OSError, AttributeError) as error:
        raise ImportError(
            f"the library of {distribution} {version} does not offer its C functions here: {error}"
        ) from None
    return opened_library


def structure(declarations: str) -> type[ctypes.Structure]:
    """A structure from its declaration in C; every pointer is a void pointer.

    Examples
    --------
    >>> [name for name, _ in structure("int n, m; double *x;")._fields_]
    ['n', 'm', 'x']
    """
    lines = (line.split(maxsplit=1) for line in declarations.split(";") if line.strip())
    fields = [
        (name.strip(" *\n"), ctypes.c_void_p if "*" in name else {"int": ctypes.c_int, "double": ctypes.c_double}[kind])
        for kind, names in lines
        for name in names.split(",")
    ]
    return type("Structure", (ctypes.Structure,), {"_fields_": fields})


class CompiledLibrary(LibrarySolver):
    """A solver behind the two C functions of a timed loop; its ``build`` sets it up and calls ``pack_state``."""

    lane = Lane.KERNEL

    def pack_state(self, *values: Any) -> None:
        """Make the state: the data, then the fields that <name>.c declares (numbers, arrays, functions, pointers)."""
        p, self._loop = self.program, Loop.in_dll(CORE, f"library_{self.name}")
        self._referenced = values  # the state has their addresses
        self.state: NDArray[np.int64] = np.array(list(map(_as_integer, (p.P, p.q, p.d, *values))), dtype=np.int64)
        self._addresses = np.array(list(map(_as_integer, (self.state, self._loop.update, self._loop.solve))))

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        self.refuse(self._loop.update(address(self.state), address(P), address(q)))

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        x = np.full(self.program.d, np.nan)
        self._loop.solve(address(self.state), address(warm_start), address(x))
        return x

    def loop(self) -> Callable[..., int]:
        return partial(bindings.time_library, self._addresses)

    def remember(self, P: Matrix | None, q: Vector, x: Vector) -> None:
        super().remember(P, q, x)
        # the arrays of the loop are released when it ends
        self.state[:2] = _as_integer(self.program.P), _as_integer(self.program.q)


def _as_integer(value: Any) -> int:
    if isinstance(value, int):
        return value
    return value.ctypes.data if isinstance(value, np.ndarray) else ctypes.cast(value, ctypes.c_void_p).value or 0
