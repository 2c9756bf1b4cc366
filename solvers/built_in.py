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

from solvers.adapter import Adapter, Program, Report, Stack
from solvers.checks import check_status
from solvers.core import BUILT_WITH, CAPPED, OK, REASONS, UNSOLVED, bindings, block, field_views
from solvers.protocol import DATA, SETUP, Lane, Matrix, Vector, box_duals


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
            is_valid, expected = isinstance(value, bool | np.bool_), "True or False"
        else:
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            is_valid = number and bool(0 <= value <= self.most) and not (self.whole and value % 1)
            limits = f"from 0 to {self.most}" if self.most < np.inf else "of at least 0"
            expected = f"a {'whole ' * self.whole}number {limits}"
        if not is_valid:
            raise ValueError(f"{name} must be {expected}, not {value!r}")
        return int(value) if self.whole else value


class BuiltInSolver(Adapter):
    """A solver of problems with bounds only, whose compiled functions work on one block of memory."""

    lane = Lane.KERNEL
    licence = "MIT"
    distribution = "piezobench"
    built_with = BUILT_WITH
    warm_startable = True
    bounds_only = True
    known: ClassVar[Mapping[str, Setting]]
    """The settings by name."""
    core: ClassVar[str]
    """Name of its compiled functions, such as <core>_bytes, the size of a state of d variables."""
    set_data: ClassVar[Callable[..., int]]
    """The one that checks types and shapes of P and q, and takes them unless they are None; a status."""
    run: ClassVar[Callable[..., int]]
    """The one that solves, warm or cold; a status."""
    state: Any = None
    field: Mapping[str, Vector]
    """Views of the fields of the state, by their names in ``bindings_*.c``."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        if unknown := sorted(self.settings.keys() - self.known.keys()):
            raise ValueError(f"{self.name} has no setting {unknown[0]!r}; it has {', '.join(self.known)}")
        self.options = {
            name: setting.checked(f"{self.name}: {name}", self.settings.get(name, setting.default))
            for name, setting in self.known.items()
        }
        self._warm = self.options.get("warm", False)

    @abstractmethod
    def run_from(self, start: Vector | None) -> int:
        """Solve from ``start`` (d,), finite; a status."""

    @abstractmethod
    def extras(self) -> dict[str, Any]:
        """What ``solution`` says beyond answer and status."""

    def build(self, p: Program, rows: Stack) -> None:
        """Allocate the state, and take bounds and data."""
        size, begin, offsets = (
            getattr(bindings, f"{self.core}_{what}") for what in ("bytes", "setup", "field_offsets")
        )
        self.state = block(size(p.d))
        check_status(begin(self.state, p.lb, p.ub), f"{self.name}: ")
        check_status(self.set_data(self.state, p.P, p.q), f"{self.name}: ", P=p.P, q=p.q)
        self.field = field_views(self.state, offsets(self.state))

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P or q of the same shape; ValueError as in ``setup``, after which the solver may not be ready."""
        try:
            status = self.set_data(self.state, P, q)
        except (TypeError, ValueError, BufferError):  # arrays of other types and layouts are converted
            self._check_ready(self._missing & SETUP)
            P, q = self.program.shaped(P, q)
            status = self.set_data(self.state, P, q)
        self._verdict = UNSOLVED
        if status or self._missing:
            supplied = {name for name, array in (("P", P), ("q", q)) if array is not None}
            self._missing = self._missing | supplied if status else self._missing - supplied
            check_status(status, f"{self.name}: ", P=P, q=q)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the answer, shape (d,), that the next call may overwrite.

        Raises
        ------
        ValueError
            There is no problem or its last update was refused, the starting point is not finite, or the problem is
            unbounded below.
        """
        if self._missing:
            self._check_ready(self._missing)
        if warm_start is None:
            self._verdict = self.run(self.state, self._warm)
        else:
            self._verdict = self.run_from(self.program.start(warm_start))
        if self._verdict:
            check_status(self._verdict, f"{self.name}: ")
        return self.x

    def accepted(self, status: int) -> int:
        """Not ready until other data come if the last ones are refused."""
        if status not in (OK, CAPPED):
            self._missing = DATA
        check_status(status, f"{self.name}: ")
        return status

    def report(self) -> Report:
        """Found if its status is that of a full solve and the answer is finite."""
        p, x = self.program, self.x
        found = self._verdict == OK and bool(np.isfinite(x).all())
        return Report(found, box_duals(p.P @ x + p.q, p.lb, p.ub, x), REASONS[self._verdict], more=self.extras())
