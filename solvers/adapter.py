"""Base class of the adapters of solver libraries: conversion of the constraints, checks, the answer with its duals.

The file of an adapter, whose name is the solver's, declares the properties of its library and has up to four short
methods:

    build         make the library's object, once
    pass_data     pass new P and q to it; not needed if the library reads the program at each solve
    call_library  call it; x as it is returned, or None if the library returns none
    report        read whether x is found, multipliers, status and counts of the last call
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from qpsolvers import Problem, Solution

from solvers.backend import Backend
from solvers.core import REASONS, UNSOLVED
from solvers.protocol import AT_WORK, READY, SETUP, Lane, Matrix, Solver, Unsupported, Vector, only_box
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

    found: bool
    """Whether the library calls its answer found."""
    w: Vector
    """Multipliers of the rows in the adapter's ``form``; unused if the library returned no answer."""
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
    refuses_fixed: ClassVar[bool] = False
    """Whether it cannot take a variable fixed by lb = ub."""
    reads_given_arrays: ClassVar[bool] = False
    """Whether ``pass_data`` is all that the library needs of new data; then it gets the caller's arrays without a copy,
    and only ``solution`` refers to them later."""
    program: Program
    rows: Any
    x: Vector | None = None
    """The last answer as the library returned it, NaN for none; None before a solve of the present data."""

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
        if self.settings and not (self.library.tolerances or self.library.rung_settings or self.fixed_settings):
            raise ValueError(f"{self.name} has no settings, so none is {', '.join(sorted(self.settings))}")
        if self.bounds_only:
            only_box(problem, self.name)
        p = Program(problem)
        if self.refuses_fixed and np.any(p.lb == p.ub):
            raise Unsupported(f"{self.name} needs lb < ub, and a variable is fixed by lb = ub")
        self._missing, self.x = SETUP, None
        self.program, self.rows = p, self.form(p)
        self.build(p, self.rows)
        self._missing = READY

    def build(self, p: Program, rows: Any) -> None:
        """Make the library's object of the program and its rows, if it has one."""

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        """Pass P (d, d) and q (d,), views of the program's arrays, to the library; None for unchanged data."""

    @abstractmethod
    def call_library(self, warm_start: Vector | None) -> Vector | None:
        """Call the library, from a contiguous ``warm_start`` (d,) or cold; x (d,) as it returns it, whatever it says of
        it, or None if it returns none."""

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Pass P (d, d) and q (d,) on, of any strides; if the library refuses them, it must be set up again."""
        self._begin(Program.set_data, P, q, not self.reads_given_arrays)
        self.x = None
        if P is not None or q is not None:  # Clarabel panics at an update of nothing
            self.pass_data(None if P is None else self.program.P, None if q is None else self.program.q)
        self._missing = READY

    def _begin(self, check: Callable[..., Any], *arguments: Any) -> Any:
        """Begin a call of the library: until its end, or for good if the library raises, the solver is not ready.
        Returns what ``check`` makes of the program and arguments; if it refuses these, the solver is as it was."""
        if self._missing:
            self._require(self._missing)
        self._missing = AT_WORK  # no other thread runs between the test and this
        try:
            return check(self.program, *arguments)
        except BaseException:
            self._missing = READY
            raise

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the library's answer, read-only, whether the library calls it found or not, and NaN if it returned
        none; ValueError if the solver is not ready."""
        start = None if warm_start is None and not self._missing else self._begin(Program.start, warm_start)
        self._missing, self.x = AT_WORK, None
        x = self.call_library(start)
        self.x, self._missing = np.full(self.program.d, np.nan) if x is None else x, READY
        self.x.setflags(write=False)  # the solution may have the same memory
        return self.x

    @abstractmethod
    def report(self) -> Report:
        """Read the library's report on its last solve."""

    def solution(self) -> Solution:
        """Return the answer with the multipliers of the problem's own rows, found if the library says so; no answer if
        it returned none or NaN, and before a solve of the present data. ValueError as ``solve`` if the solver is not
        ready."""
        self._require(self._missing)
        if self.x is None:
            return self.program.solution({"status": REASONS[UNSOLVED]})
        found, w, status, iterations, reported_us = self.report()
        extras = {"status": status, "reported_us": reported_us, "iterations": iterations}
        answer = () if np.isnan(self.x).all() else (self.x, self.rows.scatter(w), found)
        return self.program.solution(extras, *answer)

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
            raise Unsupported(f"{self.name} refuses the data with exit flag {flag}: P is not positive semidefinite")
