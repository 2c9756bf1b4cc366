"""Solvers that are C of fixed dimensions, called through the functions of ``embedded.h``.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Timed by the loop of the lane kernel: ``update`` copies P and q into the solver's memory, ``solve`` is the call that its
users make and the copy of its answer. ``setup`` generates and builds on the first problem of a shape (some seconds, see
:mod:`solvers.codegen._build`) and loads the library for all later ones.
"""

import ctypes
import importlib.metadata
from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import numpy as np

from solvers.adapter import Program, Report, Stack
from solvers.arrays import address
from solvers.backend import Backend, absolute
from solvers.codegen._build import CORE, HERE, KERNEL, Sources, built_with, library
from solvers.kernel._library import CompiledLibrary, Loop
from solvers.protocol import Lane, Matrix, Unsupported, Vector


class Shape(NamedTuple):
    """The part of a problem that is compiled in: d, and the variables with a finite lower or upper bound."""

    d: int
    below: tuple[int, ...]
    above: tuple[int, ...]

    @classmethod
    def of(cls, lb: Vector, ub: Vector) -> "Shape":
        """The shape of a box."""
        below, above = (tuple(np.flatnonzero(np.isfinite(side)).tolist()) for side in (lb, ub))
        return cls(lb.size, below, above)

    @property
    def bounded(self) -> tuple[int, ...]:
        """Variables with a finite bound."""
        return tuple(sorted({*self.below, *self.above}))

    def header(self) -> str:
        """The text of ``problem.h``.

        Examples
        --------
        >>> print(Shape(2, (1,), ()).header().splitlines()[1])
        enum { BELOW = 1 };
        """
        lines = [f"enum {{ D = {self.d} }};"]
        for name in ("below", "above", "bounded"):
            indices: tuple[int, ...] = getattr(self, name)
            values = ", ".join(map(str, indices)) or "0"  # C has no empty arrays
            lines += [f"enum {{ {name.upper()} = {len(indices)} }};", f"static const int {name}[] = {{ {values} }};"]
        return "\n".join(lines) + "\n"


def generator(algorithm: str, licence: str, distribution: str) -> Backend:
    """The entry of a library whose C has one tolerance c · 10⁻ᵏ, used as absolute and as relative one."""
    return Backend(algorithm, licence, distribution, {"tolerance": absolute}, (4, 6, 8, 10, 12, 13))


class Embedded(CompiledLibrary):
    """A solver behind ``embedded.h``; a subclass generates its C."""

    lane = Lane.CODEGEN
    built_with = built_with()
    bounds_only = True
    refuses_crossing = True
    parameters: ClassVar[Mapping[str, float]] = MappingProxyType({"tolerance": -1.0})
    """The settings in the order of the C function, with their defaults; a negative tolerance means the library's
    default."""
    compiled_in: ClassVar[tuple[str, ...]] = ()
    """The settings that ``generate`` writes into the C."""

    @abstractmethod
    def generate(self, shape: Shape, folder: Path) -> Sources:
        """Write the C of this solver for problems of this shape into the folder, which has ``problem.h``."""

    def build(self, p: Program, rows: Stack) -> None:
        if unknown := sorted(set(self.settings) - set(self.parameters)):
            raise ValueError(
                f"{self.name} has no setting {unknown[0]!r} in the lane codegen; it has {', '.join(self.parameters)}"
            )
        shape = Shape.of(p.lb, p.ub)
        if not shape.bounded:
            raise Unsupported("the lane codegen builds solvers for problems with bounds, and this one has none")
        self._z = np.empty(p.d)
        self._library = library(self._key(shape), lambda folder: self.sources(shape, folder))
        self._library.embedded_report.restype = ctypes.c_char_p
        values = np.array([float({**self.parameters, **self.settings}[name]) for name in self.parameters])
        if self._library.embedded_setup(address(p.lb), address(p.ub), address(values)):
            raise ValueError(f"{self.name} refuses the bounds")
        self.pack_state(loop=Loop.in_dll(self._library, "library_embedded"))
        self.pass_data(p.P, p.q)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        p = self.program
        if not (np.isfinite(p.P).all() and np.isfinite(p.q).all()):
            raise ValueError(f"{self.name}: P and q must be finite")
        super().pass_data(P, q)

    def report(self) -> Report:
        iterations = ctypes.c_int()
        status = self._library.embedded_report(address(self._z), ctypes.byref(iterations)).decode()
        return Report(self.x, self._z, status, iterations.value)

    def _key(self, shape: Shape) -> list[bytes]:
        """Dependencies of the built library: the version of the generator and all sources that may be part of it."""
        files = [*HERE.glob("*.py"), *HERE.glob("*.[ch]"), *CORE.glob("*.[ch]"), KERNEL / "library.h"]
        settings = {name: self.settings.get(name) for name in self.compiled_in}
        words = self.name, importlib.metadata.version(self.distribution), repr(shape), repr(settings)
        return [*(word.encode() for word in words), *(path.read_bytes() for path in sorted(files))]

    def sources(self, shape: Shape, folder: Path) -> Sources:
        """All C of this solver for problems of this shape; generated files are written to ``folder``."""
        (folder / "problem.h").write_text(shape.header(), encoding="utf-8")
        written = self.generate(shape, folder)
        return Sources((*written.files, HERE / f"{self.name}.c"), written.options)  # which implements ``embedded.h``


class GeneratedBuiltIn(Embedded):
    """A solver of this project, from the files of ``solvers/core`` that it needs."""

    core: ClassVar[tuple[str, ...]]
    """Names of C files."""
    state_bytes: ClassVar[Callable[[int], int]]
    """Size of the state of a problem of d variables."""

    def generate(self, shape: Shape, folder: Path) -> Sources:
        options = (
            f"-DMEMORY_BYTES={type(self).state_bytes(shape.d)}",
            f"-DCORE_VARIABLES={shape.d}",
            "-ffp-contract=off",
            "-fno-math-errno",
            "-fno-trapping-math",
        )
        return Sources(tuple(CORE / f"{name}.c" for name in self.core), options)
