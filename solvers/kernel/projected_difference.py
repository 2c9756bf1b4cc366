"""The paper's solver: the projected difference equation.

    w(k+1) = Proj(w(k) − η (P w(k) + q)),    0 < η < 2/λ_max(P)

minimises ½ wᵀP w + qᵀw over a box: in slope coordinates the set of the paper's (7) is one, and the projection clips.
Source, proof and arithmetic stand in ``solvers/core/descent.c``. The paper runs 15 200 steps: one per sampling period
of 125 µs for 1.9 s.
"""

from collections.abc import Mapping
from functools import partial
from numbers import Real
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.core import OK, REASONS, bindings
from solvers.descent import ProjectedGradient
from solvers.ours import Ours
from solvers.protocol import Lane, Matrix, Nanoseconds, Solver, Unsupported, Vector, box_solution, dense, only_box
from solvers.timed_calls import Timings, follow_rows

MOST_STEPS = 2**53


class ProjectedDifference(Ours, Solver):
    """Projected gradient with a fixed step, for problems with bounds only.

    A number of steps is asked for and not a tolerance, so its rungs are numbers of steps.

    Settings
    --------
    steps : int, default 15200
        Steps of one solve; the most where ``tolerance`` is set.
    step_ratio : float, default 0.5
        η λ_max/2, in (0, 1): the step as a part of the stability limit 2/λ_max; the default is η = 1/λ_max, which
        damps every direction without overshoot.
    allow_divergence : bool, default False
        Permit a step_ratio of 1 and more, which does not converge.
    diagonal_scaling : bool, default False
        Iterate in the variables w/D, D = diag(P)^−½, which keeps a box a box.
    tolerance : float or None, default None
        Stop where the projected gradient |w(k+1) − w(k)|/η falls to this part of |q| (2-norms, looked at every 16
        steps). None, the paper's, looks at nothing.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = ProjectedDifference(steps=3)
    >>> s.setup(qpsolvers.Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [0.875, 0.0]
    """

    name: ClassVar[str] = "projected_difference"
    lane: ClassVar[Lane] = Lane.KERNEL
    algorithm: ClassVar[str] = "projected gradient"
    warm_startable: ClassVar[bool] = True
    iteration_setting: ClassVar[str | None] = "steps"
    always: ClassVar[Mapping[str, Any]] = MappingProxyType({"steps": 15200})

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Numbers of steps; the last is the paper's."""
        return tuple({"steps": steps} for steps in (1, 10, 100, 1000, 15200))

    def setup(self, problem: Problem) -> None:
        """Allocate, find the step and store P for it.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A number is not finite where it must be, P is indefinite, bounds cross, or a setting is out of range.
        """
        self._lb, self._ub = only_box(problem, self.name)
        settings = self.settings
        numbers = {
            "steps": settings["steps"],
            "step_ratio": settings.get("step_ratio", 0.5),
            "tolerance": settings.get("tolerance"),
        }
        for name, value in numbers.items():
            if not (isinstance(value, Real) or (name == "tolerance" and value is None)):
                raise ValueError(f"{self.name}: {name} must be a number, and it is {value!r}")
        if not 0 <= numbers["steps"] <= MOST_STEPS:
            raise ValueError(f"{self.name}: steps must be from 0 to {MOST_STEPS}, and it is {numbers['steps']}")
        self._steps, self._ratio = int(numbers["steps"]), float(numbers["step_ratio"])
        self._tolerance = -1.0 if numbers["tolerance"] is None else float(numbers["tolerance"])
        self._scaled = bool(settings.get("diagonal_scaling", False))
        if not 0 < self._ratio < (np.inf if settings.get("allow_divergence", False) else 1):
            raise ValueError(
                f"{self.name}: step_ratio must lie between 0 and 1 (the stability limit), and it is "
                f"{self._ratio}; allow_divergence=True permits more"
            )
        self._P, self._q = dense(problem)
        self._descent = ProjectedGradient(self._lb, self._ub, self.name)
        self.update(self._P, self._q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P (a new step follows from it) or q; raises ValueError as ``setup`` does."""
        if P is not None:
            np.copyto(self._P, P)
        if q is not None:
            np.copyto(self._q, q)
        self._descent.take(None if P is None else self._P, None if q is None else self._q, self._ratio, self._scaled)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is the projection of ``warm_start``, or of 0."""
        self.begin(warm_start)
        self.advance(self._steps)
        return self.answer()

    def begin(self, start: Vector | None) -> None:
        """Put the recursion at the projection of ``start`` (d,), to be moved on by ``advance`` as the machine runs."""
        self._descent.start(start)

    def advance(self, steps: int) -> None:
        """Take so many steps from where the recursion stands."""
        self._descent.run(steps, self._tolerance)

    def answer(self) -> Vector:
        """Return the iterate (d,) where the recursion stands."""
        return self._descent.answer()

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:
        """Take each P and q and run the steps from 0 or ``warm_start``, timed."""
        timings = self._descent.time(
            bindings.time_projected, self._steps, self._tolerance, self._ratio, self._scaled, P, q, warm_start, most_ns
        )
        last = timings[0].size - 1
        self._P[:], self._q[:] = P[last], q[last]
        return timings

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows one after the other, ``steps`` steps after each from where the last ones ended; all is timed but
        the data."""
        if self._scaled or self._tolerance >= 0.0:
            raise Unsupported(f"{self.name} follows rows without diagonal scaling and tolerance only")
        loop = partial(bindings.projected_follow, self._descent.state, self._ratio, self._steps)
        status, answers, nanoseconds = follow_rows(loop, self._P, self._q, rows, forgetting)
        if status != OK:
            raise ValueError(f"{self.name}: {REASONS[status]}")
        return answers, nanoseconds

    def solution(self) -> Solution:
        """Return the last iterate; ``extras`` say steps and step size."""
        x = self.answer()
        return box_solution(
            Problem(self._P, self._q, lb=self._lb, ub=self._ub),
            x,
            bool(np.isfinite(x).all()),
            steps=self._descent.taken,
            eta=self._descent.eta,
        )
