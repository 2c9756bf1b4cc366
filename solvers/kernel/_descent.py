"""Projected gradient methods in C, see ``solvers/core/descent.h``."""

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

import numpy as np

from solvers.built_in import BuiltInSolver
from solvers.core import CAPPED, OK, bindings
from solvers.protocol import Matrix, Vector


class ProjectedGradient(BuiltInSolver):
    """A method for problems with bounds only, in the variables w = x/D; D is 1 or diag(P)^−½, with which a box stays a
    box."""

    core = "descent"
    take_steps: ClassVar[Callable[..., int]]
    """The compiled steps."""
    timed_loop: ClassVar[Callable[..., int]]
    """The compiled loop that times ``update`` and ``solve``."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        tolerance = self.options["tolerance"]
        self._rule = float(self.options.get("step_ratio", 0.5)), int(self.options["diagonal_scaling"])
        self._limits = self.options["steps"], -1.0 if tolerance is None else float(tolerance)

    def set_data(self, state: Any, P: Matrix | None, q: Vector | None) -> int:
        status = bindings.descent_set_data(state, P, q, *self._rule)
        if status == OK and P is not self.program.P:
            self.program.set_data(P, q)
        return status

    def run(self, state: Any, warm: bool) -> int:
        return self.run_from(None)

    def run_from(self, start: Vector | None) -> int:
        """Take the steps from the projection of ``start``, or of 0. An answer is exactly at a bound if the scaled one
        is."""
        bindings.descent_start(self.state, start)
        type(self).take_steps(self.state, *self._limits)
        bindings.descent_answer(self.state)
        self.x = self.field["answer"].copy()
        self.x.setflags(write=False)
        return OK if self.field["met"].view(np.int32)[0] else CAPPED

    def loop(self) -> Callable[..., int]:
        return partial(type(self).timed_loop, self.state, *self._rule, *self._limits)

    def extras(self) -> dict[str, Any]:
        """The number of steps and the step size."""
        return {"steps": int(self.field["steps"].view(np.int64)[0]), "eta": float(self.field["eta"][0])}
