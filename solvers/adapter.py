"""Base classes of solvers: the state of readiness, conversion of the constraints, the answer with its duals.

The file of an adapter, whose name is the solver's, declares the properties of its library and has up to four short
methods:

    build         make the library's object, once
    pass_data     pass new P and q to it; not needed if the library reads the program at each solve
    call_library  call it; x as it is returned, or None if the library returns none
    report        read whether x is found, multipliers, status and counts of the last call
"""

from abc import abstractmethod
from collections.abc import Callable, Container, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers.backend import DIRECT, Backend
from solvers.core import CAPPED, OK, REASONS, UNSOLVED
from solvers.protocol import (
    AT_WORK,
    DATA,
    READY,
    Lane,
    Matrix,
    Solver,
    Timings,
    Unsupported,
    Vector,
    only_box,
)
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
    "behind",
    "csc_matrix",
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
    more: Mapping[str, Any] = MappingProxyType({})
    """Further details of the solver."""


class Adapter(Solver):
    """A solver whose problem is a :class:`Program`, and which obeys the state of readiness of :class:`Solver`."""

    form: ClassVar[type[Any]] = Stack
    """The form of the rows that the solver takes, from :mod:`solvers.rows`."""
    bounds_only: ClassVar[bool] = False
    """Whether it takes no general rows."""
    refuses_fixed: ClassVar[bool] = False
    """Whether it cannot take a variable fixed by lb = ub."""
    x: Vector
    """The last answer."""

    def setup(self, problem: Problem) -> None:
        """Convert the problem and make what solves it; a problem that is refused leaves the solver as it was.

        It is set up in another solver of the same settings, whose attributes this one takes over, so what ``build``
        uses must follow from the settings.

        Raises
        ------
        Unsupported
            The solver cannot take a feature of the problem.
        ValueError
            The data fail a check of :mod:`solvers.checks`, or the solver refuses them.
        """
        made = type(self)(**self.settings)  # apart: a refusal changes nothing
        made._set_up(problem)
        for name, value in vars(made).items():  # in Python 3.11, vars(self) would slow each later access by 30 ns
            setattr(self, name, value)

    def _set_up(self, problem: Problem) -> None:
        if self.bounds_only:
            only_box(problem, self.name)
        self.program = p = Program(problem)
        if self.refuses_fixed and np.any(p.lb == p.ub):
            raise Unsupported(f"{self.name} needs lb < ub, and a variable is fixed by lb = ub")
        self.rows = self.form(p)
        self.build(p, self.rows)
        self._missing, self._verdict = READY, UNSOLVED

    def build(self, p: Program, rows: Any) -> None:
        """Make the library's object of the program and its rows, if it has one; it moves to another solver with all
        attributes, so nothing may keep a reference to this one."""

    def _begin(self, check: Callable[..., Any], *arguments: Any, supplied: frozenset[str] = READY) -> Any:
        """Begin a call that supplies these data. The solver is not ready until the call ends, or for good if a library
        raises. Returns the result of ``check`` for the program and arguments; if that raises, the solver is as it was.
        """
        missing = self._missing
        if missing:
            self._check_ready(missing - supplied)
        self._missing = AT_WORK  # no other thread runs between the test and this
        try:
            return check(self.program, *arguments)
        except BaseException:
            self._missing = missing
            raise

    def loop(self) -> Callable[..., int]:
        """The function of the core that times ``update`` and ``solve``; its last arguments are those of ``TIMED`` in
        ``bindings_timed.h``."""
        raise Unsupported(f"{self.name} has no compiled loop to time")

    @abstractmethod
    def accepted(self, status: int) -> int:
        """The status of the answer after the loop ended with this one, or an error."""

    def remember(self, P: Matrix | None, q: Vector, x: Vector) -> None:
        """Keep the last data and answer of the loop."""
        self.program.set_data(P, q)
        self.x = x.copy()

    def time_kernel(
        self, P: Matrix | None, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf
    ) -> Timings:
        """Time the update with each P, None if it is fixed, and q, and the solve after it, which starts as ``solve()``
        does or from ``warm_start``."""

        def run(program: Program) -> tuple[int, Matrix | None, Matrix, Timings]:
            flat, qs, start = program.several(P, q, warm_start)
            n, d = qs.shape
            updates, solves, answers = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.full((n, d), np.nan)
            made, longest = np.zeros(1, dtype=np.int64), int(min(most_ns, 2**62))
            data = qs, None if flat is None else flat.reshape(n, d * d)
            status = self.loop()(*data, start, longest, updates, solves, answers, made)
            m = int(made[0])
            return status, flat, qs, (updates[:m], solves[:m], answers[:m])

        status, P, q, timings = self._begin(run, supplied=frozenset({"q"}) if P is None else DATA)
        last = timings[0].size - 1
        self.remember(None if P is None else P[last], q[last], timings[2][last])
        self._verdict = UNSOLVED
        self._verdict = self.accepted(status)
        self._missing = READY
        return timings

    @abstractmethod
    def report(self) -> Report:
        """Read the report on the last solve."""

    def solution(self) -> Solution:
        """Return the answer with the multipliers of the problem's own rows, found if the solver says so; no answer if
        it returned none or NaN, and before a solve of the present data. ValueError as ``solve`` if the solver is not
        ready."""
        self._check_ready(self._missing)
        if self._verdict not in (OK, CAPPED):
            return self.program.solution({"status": REASONS[self._verdict]})
        found, w, status, iterations, reported_us, more = self.report()
        extras = {"status": status, "reported_us": reported_us, "iterations": iterations, **more}
        answer = () if np.isnan(self.x).all() else (self.x, self.rows.scatter(w), found)
        return self.program.solution(extras, *answer)


class LibrarySolver(Adapter):
    """A solver of another author's library."""

    lane = Lane.DIRECT
    library: ClassVar[Backend]
    """By default, the entry of the file's name in :data:`solvers.backend.DIRECT`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        name = vars(cls).get("name", cls.__module__.rpartition(".")[2])
        if b := vars(cls).get("library", DIRECT.get(name)):
            cls.name, cls.library = name, b
            cls.algorithm, cls.licence, cls.distribution = b.algorithm, b.licence, b.distribution
            cls.fixed_settings, cls.exponents = b.fixed_settings, b.exponents

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """The rungs of the library's entry."""
        return cls.library.ladder(c)

    def setup(self, problem: Problem) -> None:
        """Refuse settings of a library that has none, and make the library's object."""
        if self.settings and not (self.library.tolerances or self.library.rung_settings or self.fixed_settings):
            raise ValueError(f"{self.name} takes no settings, got {', '.join(sorted(self.settings))}")
        super().setup(problem)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        """Pass P (d, d) and q (d,), views of the program's arrays, to the library; None for unchanged data."""

    @abstractmethod
    def call_library(self, warm_start: Vector | None) -> Vector | None:
        """Call the library, from a contiguous ``warm_start`` (d,) or cold; x (d,) as it returns it, whatever it says of
        it, or None if it returns none."""

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Pass P (d, d) and q (d,) on, of any strides; if the library refuses them, it must be set up again."""
        self._begin(Program.set_data, P, q)
        self._verdict = UNSOLVED
        if P is not None or q is not None:  # Clarabel panics at an update of nothing
            self.pass_data(None if P is None else self.program.P, None if q is None else self.program.q)
        self._missing = READY

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the library's answer, read-only, whether the library calls it found or not, and NaN if it returned
        none; ValueError if the solver is not ready."""
        start = None if warm_start is None and not self._missing else self._begin(Program.start, warm_start)
        self._missing, self._verdict = AT_WORK, UNSOLVED
        x = self.call_library(start)
        self.x = np.full(self.program.d, np.nan) if x is None else x
        self.x.setflags(write=False)  # the solution may have the same memory
        self._missing, self._verdict = READY, OK
        return self.x

    def accepted(self, status: int) -> int:
        """Raise :class:`Unsupported` if the library refuses the last data."""
        self.refuse(status)
        return OK

    def apply_settings(self, target: Any, **defaults: Any) -> Any:
        """Write the defaults and the settings into the library's own object, and return it.

        Raises
        ------
        ValueError
            The library has no such setting.
        """
        for name, value in {**defaults, **self.settings}.items():
            if not hasattr(target, name):
                raise ValueError(f"{self.name} has no setting {name}")
            setattr(target, name, value)
        return target

    def refuse(self, flag: int) -> None:
        """Raise :class:`Unsupported` if the library refuses the data, which it does by a negative flag."""
        if flag < 0:
            raise Unsupported(f"{self.name} refuses the data with exit flag {flag}: P is not positive semidefinite")


def behind(
    base: type[LibrarySolver],
    libraries: Mapping[str, Backend],
    installed: Container[str],
    warm_startable: Container[str] = (),
) -> Any:
    """The function ``make`` of a lane: the class of one solver of its table, ImportError if it is not installed."""

    def make(name: str) -> type[Solver]:
        if name not in installed:
            raise ImportError(f"{name!r} is not installed, or {base.lane.value} does not find it")
        described = {
            "__doc__": f"{name} behind {base.lane.value}.",
            "name": name,
            "library": libraries[name],
            "warm_startable": name in warm_startable,
        }
        return type(f"{base.lane.value.capitalize()}_{name}", (base,), described)

    return make
