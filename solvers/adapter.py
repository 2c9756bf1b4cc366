"""Base class of the adapters of solver libraries: conversion of the constraints, checks, the answer with its duals.

The file of an adapter, whose name is the solver's, declares the properties of its library and has up to four short
methods:

    build         make the library's object, once
    pass_data     pass new P and q to it; not needed if the library reads the program at each solve
    call_library  call it; x, or None if it found no answer
    report        read multipliers, status and counts of the last call
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, NoReturn

import numpy as np
from qpsolvers import Problem, Solution

from solvers.backend import Backend
from solvers.core import REASONS, UNSOLVED
from solvers.protocol import Lane, Matrix, Solver, Unsupported, Vector, only_box
from solvers.rows import Cones, Intervals, Program, Stack, Triangle

# The names that the files of adapters import.
__all__ = [
    "Cones",
    "Intervals",
    "Lane",
    "LibrarySolver",
    "Matrix",
    "Program",
    "Report",
    "Stack",
    "Triangle",
    "Unsupported",
    "Vector",
]


class Report(NamedTuple):
    """Report of a library on its last solve."""

    x: Vector
    w: Vector
    """Multipliers of the rows in the adapter's ``form``."""
    status: str
    """The library's own name of it."""
    iterations: int | None = None
    """The library's own count."""
    reported_us: float | None = None
    """The solve time that the library itself reports."""


class LibrarySolver(Solver):
    """A solver of another author's library."""

    lane = Lane.DIRECT
    library: ClassVar[Backend]
    form: ClassVar[type[Any]] = Stack
    """The form of the rows that the library takes, from :mod:`solvers.rows`."""
    bounds_only: ClassVar[bool] = False
    """Whether it takes no general rows."""
    refuses_crossing: ClassVar[bool] = False
    """Whether it refuses crossing bounds instead of reporting infeasibility."""
    refuses_fixed: ClassVar[bool] = False
    """Whether it cannot take a variable fixed by lb = ub."""
    why_refused: ClassVar[str] = ""
    """Possible reasons of a refusal by ``refuse``, beginning with a colon."""
    reads_given_arrays: ClassVar[bool] = False
    """Whether ``pass_data`` is all that the library needs of new data; then it gets the caller's arrays without a copy,
    and only ``solution`` refers to them later."""
    program: Program
    rows: Any
    found: bool | None = None
    """Whether the last solve found an answer; None before a solve of the present data."""
    _ready: bool | None = None
    """Whether the library has the data; None without a good set-up."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "library" in vars(cls):
            b = cls.library
            cls.algorithm, cls.licence, cls.distribution = b.algorithm, b.licence, b.distribution
            cls.fixed_settings, cls.exponents = b.fixed_settings, b.exponents
            cls.name = vars(cls).get("name", cls.__module__.rpartition(".")[2])

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """The rungs of the library's entry."""
        return cls.library.ladder(c)

    def setup(self, problem: Problem) -> None:
        """Refuse problems that the library cannot take, convert the others and make the library's object."""
        b, self._ready, self.found = self.library, None, None
        if self.settings and not (b.tolerances or b.rung_settings or b.fixed_settings):
            raise ValueError(f"{self.name} has no settings, so none is {', '.join(sorted(self.settings))}")
        if self.bounds_only:
            only_box(problem, self.name)
        self.program = p = Program(problem)
        if np.isnan(p.lb).any() or np.isnan(p.ub).any():
            raise ValueError(f"{self.name}: a bound must not be NaN")
        if self.refuses_crossing and np.any(p.lb > p.ub):
            raise Unsupported(
                f"{self.name} refuses bounds that cross, and a lower bound of the problem is above its upper one"
            )
        if self.refuses_fixed and np.any(p.lb == p.ub):
            raise Unsupported(f"{self.name} needs lb < ub, and a variable is fixed by lb = ub")
        self.rows = self.form(p)
        self.build(p, self.rows)
        self._ready = True

    @abstractmethod
    def build(self, p: Program, rows: Any) -> None:
        """Make the library's object of the program and its rows."""

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        """Pass P (d, d) and q (d,), views of the program's arrays, to the library; None for unchanged data."""

    @abstractmethod
    def call_library(self, warm_start: Vector | None) -> Vector | None:
        """Call the library, from a contiguous ``warm_start`` (d,) or cold; x (d,), or None if it found no answer."""

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Pass P (d, d) and q (d,) on, of any strides; a refusal of their numbers holds until the next good update."""
        if self._ready is None:
            self._refuse_to_work()
        data = self.program.set_data(P, q, copy=not self.reads_given_arrays)
        self.found, self._ready = None, False
        if any(part is not None for part in data):  # Clarabel panics at an update of nothing
            self.pass_data(*data)
        self._ready = True

    def _refuse_to_work(self) -> NoReturn:
        needed = "setup" if self._ready is None else "update"
        raise ValueError(f"{self.name} is not ready until the next good {needed}")

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the library's answer, NaN if it found none; ValueError without data that the library took."""
        if not self._ready:
            self._refuse_to_work()
        self.found = None
        start = None if warm_start is None else np.ascontiguousarray(warm_start, dtype=np.float64)
        x = self.call_library(start)
        self.found = x is not None
        return self.program.no_answer() if x is None else x

    @abstractmethod
    def report(self) -> Report:
        """Read the library's report on its last solve; x and w are used only if it found an answer."""

    def solution(self) -> Solution:
        """Return the answer with the multipliers of the problem's own rows; before a solve of the present data, none is
        found. ValueError as ``solve`` without data."""
        if not self._ready:
            self._refuse_to_work()
        if self.found is None:
            return self.program.solution(None, None, {"status": REASONS[UNSOLVED]})
        x, w, status, iterations, reported_us = self.report()
        extras = {"status": status, "reported_us": reported_us, "iterations": iterations}
        if not self.found:
            return self.program.solution(None, None, extras)
        return self.program.solution(np.array(x), self.rows.scatter(w), extras)

    def apply_settings(self, target: Any, **defaults: Any) -> None:
        """Write the defaults and the settings into the library's own object.

        Raises
        ------
        ValueError
            The library has no such setting.
        """
        for name, value in {**defaults, **self.settings}.items():
            if not hasattr(target, name):
                raise ValueError(f"{self.name} has no setting {name}")
            setattr(target, name, value)

    def refuse(self, flag: int) -> None:
        """Raise :class:`Unsupported` if the library refuses the data, which it does by a negative flag."""
        if flag < 0:
            raise Unsupported(f"{self.name} refuses the data with exit flag {flag}{self.why_refused}")
