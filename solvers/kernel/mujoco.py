"""MuJoCo's ``mju_boxQP`` by its C interface: the algorithm and starts of the direct lane, see :mod:`solvers.direct.mujoco`.

Timed inside compiled code: ``update`` hands over pointers to the new P and q, which the library reads where they are; ``solve`` is the
library's function, from ``warm_start`` or from 0, which leaves its answer in our array.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mujoco import _functions
from qpsolvers import Problem

from solvers.core import face
from solvers.direct import mujoco as direct
from solvers.direct._box import refuse_crossing
from solvers.kernel._library import addresses
from solvers.protocol import Lane, Matrix, Nanoseconds, Timings, Vector
from solvers.timed_calls import follow_rows, time_calls

VERSION = "4.0.1"
LIBRARY = next(Path(_functions.__file__).parent.glob(f"libmujoco.*{VERSION}*"), Path(f"libmujoco {VERSION}"))
(BOX_QP,) = addresses("mujoco-core", VERSION, LIBRARY, ("mju_boxQP",))


class Mujoco(direct.Mujoco):
    """The library's ``mju_boxQP``."""

    lane = Lane.KERNEL

    def setup(self, problem: Problem) -> None:  # noqa: D102
        super().setup(problem)
        refuse_crossing(self.program, self.name)
        self._free, self._last = np.zeros(1, dtype=np.intc), np.zeros(self.program.d)
        self.outcome = direct.outcome(self._last, 0)

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:  # noqa: D102
        _, timings = time_calls(partial(face.time_mujoco, *self._problem()), P, q, warm_start, most_ns)
        last = timings[0].size - 1
        self.program.take(P[last], q[last])
        self.outcome = direct.outcome(timings[2][last].copy(), int(self._free[0]))
        return timings

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows one after the other; timed is the solve from the last answer found."""
        p = self.program
        if self.outcome.found:
            self._last[:] = self.outcome.x
        _, answers, nanoseconds = follow_rows(partial(face.mujoco_follow, *self._problem(), self._last), p.P, p.q, rows, forgetting)
        self.outcome = direct.outcome(answers[-1].copy(), int(self._free[0]))
        return answers, nanoseconds

    def _problem(self) -> tuple[Any, ...]:
        return BOX_QP, self.lb, self.ub, self._factor, self._free
