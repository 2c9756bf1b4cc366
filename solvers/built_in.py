"""Base class of the solvers that were written for this project: one contract for all of them.

Data, answer and status change together. A refused problem, starting point or array of another shape or type leaves a
solver as it was. P and q are checked while they are copied and scaled, so if their numbers are refused, part of them
is in place: then the solver is not ready, and refuses to solve, until the arrays of that update come again and are
good. Before any solve of the present data there is no answer, and none is found.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.arrays import shaped
from solvers.checks import require, several, start_point
from solvers.core import BUILT_WITH, CAPPED, OK, REASONS, UNSOLVED, bindings, block, field_views
from solvers.protocol import (
    READY,
    SETUP,
    Entrant,
    Lane,
    Matrix,
    Solver,
    Timings,
    Vector,
    box_solution,
    dense,
    only_box,
)
from solvers.timed_calls import time_calls

DATA = frozenset({"P", "q"})


@dataclass(frozen=True)
class Setting:
    """A setting: a number in a range, True or False if that is its default, or also None."""

    default: Any
    most: float = np.inf
    whole: bool = False

    def checked(self, name: str, value: Any) -> Any:
        """The value, a whole number as an int; ValueError if it is out of range or of another type."""
        if value is self.default:
            return value
        if isinstance(self.default, bool):
            good, wanted = isinstance(value, bool | np.bool_), "True or False"
        else:
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            good = number and bool(0 <= value <= self.most) and not (self.whole and value % 1)
            wanted = f"a {'whole ' * self.whole}number "
            wanted += f"from 0 to {self.most}" if self.most < np.inf else "and not negative"
        if not good:
            raise ValueError(f"{name} must be {wanted}, and it is {value!r}")
        return int(value) if self.whole else value


class BuiltIn(Entrant):
    """Licence, package and compiler of our solvers."""

    licence = "MIT"
    distribution = "piezobench"
    built_with = BUILT_WITH


class BuiltInSolver(BuiltIn, Solver):
    """A solver of problems with bounds only, whose compiled functions work on one block of memory."""

    lane = Lane.KERNEL
    warm_startable = True
    known: ClassVar[Mapping[str, Setting]]
    """The settings by name."""
    core: ClassVar[str]
    """Name of its compiled functions, such as <core>_bytes, the size of a state of d variables."""
    pass_data: ClassVar[Callable[..., int]]
    """The one that checks types and shapes of P and q, and takes them unless they are None; a status."""
    run: ClassVar[Callable[..., int]]
    """The one that solves, warm or cold; a status."""
    x: Vector
    """The answer of the last run."""
    _warm = False
    state: Any = None
    _status = UNSOLVED

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        if unknown := sorted(self.settings.keys() - self.known.keys()):
            raise ValueError(f"{self.name} has no setting {unknown[0]!r}; it has {', '.join(self.known)}")
        self.options = {
            name: setting.checked(f"{self.name}: {name}", self.settings.get(name, setting.default))
            for name, setting in self.known.items()
        }

    @abstractmethod
    def prepare(self, P: Matrix, q: Vector) -> None:
        """Get ready for a new state, which has these data."""

    @abstractmethod
    def run_from(self, start: Vector) -> int:
        """Solve from ``start`` (d,), finite; a status."""

    @abstractmethod
    def answer(self) -> Vector:
        """The last answer, shape (d,)."""

    @abstractmethod
    def data(self) -> tuple[Matrix, Vector]:
        """Copies of the present P (d, d) and q (d,)."""

    @abstractmethod
    def extras(self) -> dict[str, Any]:
        """What ``solution`` says beyond answer and status."""

    @abstractmethod
    def loop(self) -> Callable[..., int]:
        """The compiled loop that times ``update`` and ``solve``."""

    def field(self, name: str) -> Vector:
        """A view of a field of the state, by its name in ``bindings_*.c``."""
        return self._fields[name]

    def setup(self, problem: Problem) -> None:
        """Allocate, and take the data; a refused problem leaves the solver as it was.

        Raises
        ------
        Unsupported
            The problem has general rows, or no variables.
        ValueError
            A number is NaN or infinite where it may not be, P is not symmetric or indefinite beyond rounding, or bounds
            cross.
        """
        P, q = dense(problem)
        lb, ub = only_box(problem, self.name)
        size, begin, offsets = (
            getattr(bindings, f"{self.core}_{what}") for what in ("bytes", "setup", "field_offsets")
        )
        state = block(size(q.size))
        require(begin(state, lb, ub), f"{self.name}: ")
        require(self.pass_data(state, P, q), f"{self.name}: ", P=P, q=q)
        self.state, self._fields, self._lb, self._ub = state, field_views(state, offsets(state)), lb, ub
        self._missing, self._status = READY, UNSOLVED
        self.prepare(P, q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P or q of the same shape; ValueError as in ``setup``, after which the solver may not be ready."""
        try:
            status = self.pass_data(self.state, P, q)
        except (TypeError, ValueError, BufferError):  # arrays of other types and layouts are converted
            self._require(self._missing & SETUP)
            d = self._lb.size
            P = None if P is None else shaped("P", P, (d, d))
            q = None if q is None else shaped("q", q, (d,))
            status = self.pass_data(self.state, P, q)
        self._status = UNSOLVED
        if status or self._missing:
            given = {name for name, array in (("P", P), ("q", q)) if array is not None}
            self._missing = self._missing | given if status else self._missing - given
            require(status, f"{self.name}: ", P=P, q=q)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the answer, shape (d,), that the next call may overwrite.

        Raises
        ------
        ValueError
            There is no problem or its last update was refused, the starting point is not finite, or the problem is
            unbounded below.
        """
        if self._missing:
            self._require(self._missing)
        if warm_start is None:
            self._status = self.run(self.state, self._warm)
        else:
            self._status = self.run_from(start_point(warm_start, self._lb.shape))
        if self._status:
            require(self._status, f"{self.name}: ")
        return self.x

    def time_kernel(
        self, P: Matrix | None, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf
    ) -> Timings:
        """Take each P, unless it stays, and q and solve, timed; by default as ``solve()`` does, or from
        ``warm_start``."""
        self._require(self._missing - ({"q"} if P is None else DATA))
        P, q, warm_start = several(P, q, warm_start, self._lb.size)
        status, timings = time_calls(self.loop(), P, q, warm_start, most_ns)
        last = timings[0].size - 1
        self._took(None if P is None else P[last], q[last], status)
        return timings

    def _took(self, P: Matrix | None, q: Vector, status: int) -> None:
        """A loop ended with these data and this status."""
        self.remember(P, q)
        self._status, self._missing = status, frozenset() if status in (OK, CAPPED) else DATA
        require(status, f"{self.name}: ")

    def remember(self, P: Matrix | None, q: Vector) -> None:
        """Keep the data of a loop, if the state does not."""

    def solution(self) -> Solution:
        """Return the answer to the present data, found if its status is that of a full solve and it is finite;
        ValueError as ``solve`` if the solver is not ready."""
        self._require(self._missing)
        problem = Problem(*self.data(), lb=self._lb.copy(), ub=self._ub.copy())
        if self._status not in (OK, CAPPED):
            return Solution(problem, found=False, extras={"status": REASONS[self._status]})
        x, said = self.answer(), {"status": REASONS[self._status], **self.extras()}
        return box_solution(problem, x, self._status == OK and bool(np.isfinite(x).all()), **said)
