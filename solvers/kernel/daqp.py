"""DAQP by its C interface: the algorithm, settings and starts of the direct lane, see :mod:`solvers.direct.daqp`.

Timed inside compiled code: ``update`` is ``daqp_update_ldp`` with pointers to the new P and q, which the library reads where they are, and
an empty active set; ``solve`` is ``daqp_solve`` and the copy of its answer, after ``daqp_update_ldp`` with the rows that ``warm_start``
touches where there is one. The workspace is allocated once, in ``setup``.

``solvers/core/face_daqp.c`` has the structures of version 0.11.0.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import daqp
import numpy as np
from qpsolvers import Problem

from solvers.core import block, face
from solvers.direct import daqp as direct
from solvers.kernel._library import addresses
from solvers.protocol import Lane, Matrix, Nanoseconds, Timings, Vector
from solvers.timed_calls import follow_rows, time_calls

DEFAULTS, *FUNCTIONS = addresses("daqp", "0.11.0", Path(daqp.__file__), (
    "daqp_default_settings", "setup_daqp_main", "daqp_update_ldp", "daqp_solve", "free_daqp_workspace", "free_daqp_ldp"))
NEW_H, NEW_F = 1, 4
SETTINGS = ("primal_tol", "dual_tol", "zero_tol", "pivot_tol", "progress_tol", "cycle_tol", "iter_limit", "fval_bound", "eps_prox", "eta_prox",
            "rho_soft", "rel_subopt", "abs_subopt", "sing_tol", "refactor_tol", "time_limit", "w_soft", "eq_reduction", "presolve")
WHOLE = ("cycle_tol", "iter_limit", "eq_reduction", "presolve")


class Settings(ctypes.Structure):
    """``DAQPSettings``."""

    _fields_ = [(name, ctypes.c_int if name in WHOLE else ctypes.c_double) for name in SETTINGS]


class Model:
    """The part of the library's ``Model`` that the direct lane calls, by its C functions."""

    def __init__(self) -> None:
        self._settings = Settings()
        ctypes.CFUNCTYPE(None, ctypes.c_void_p)(DEFAULTS)(ctypes.addressof(self._settings))
        self.state = block(face.daqp_bytes())

    @property
    def settings(self) -> dict[str, Any]:
        """All of them by name; to set some is to leave the others."""
        return {name: getattr(self._settings, name) for name in SETTINGS}

    @settings.setter
    def settings(self, changed: Mapping[str, Any]) -> None:
        for name, value in changed.items():
            setattr(self._settings, name, value)

    def setup(self, H: Matrix, f: Vector, A: Matrix, bupper: Vector, blower: Vector, sense: direct.Sense) -> tuple[int, float]:
        """Allocate and form the problem; the library's exit flag."""
        self._x, self._lam = np.zeros(f.size), np.zeros(bupper.size)
        self._held = f, H, A, bupper, blower, sense, self._settings  # whose addresses the library keeps
        places = np.array([*FUNCTIONS, ctypes.addressof(self._settings)], dtype=np.int64)
        flag = face.daqp_setup(self.state, places, f, H, A, bupper, blower, sense, self._x, self._lam)
        if flag >= 0:  # otherwise it has let go what it allocated
            weakref.finalize(self, face.daqp_free, self.state)
        return flag, 0.0

    def update(self, H: Matrix | None = None, f: Vector | None = None, *, sense: direct.Sense) -> int:
        """Say that H or f, the arrays of ``setup``, have new numbers; the library's exit flag."""
        return face.daqp_update(self.state, (NEW_H if H is not None else 0) + (NEW_F if f is not None else 0), sense)

    def solve(self) -> tuple[Vector, float, int, dict[str, Any]]:
        """The answer, its cost, which is not asked for, the exit flag, and more."""
        return self._told(*face.daqp_solve(self.state))

    def result(self) -> tuple[Vector, float, int, dict[str, Any]]:
        """The same of the last solve."""
        return self._told(*face.daqp_result(self.state))

    def _told(self, flag: int, iterations: int, seconds: float) -> tuple[Vector, float, int, dict[str, Any]]:
        return self._x.copy(), np.nan, flag, {"iterations": iterations, "solve_time": seconds, "lam": self._lam.copy()}


class Daqp(direct.Daqp):
    """The library's workspace."""

    lane = Lane.KERNEL
    model = Model

    def setup(self, problem: Problem) -> None:  # noqa: D102
        super().setup(problem)
        self._last, self._flag = np.zeros(self.program.d), 0

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:  # noqa: D102
        p = self.program
        flag, timings = time_calls(partial(face.time_daqp, *self._problem()), P, q, warm_start, most_ns)
        last = timings[0].size - 1
        p.take(P[last], q[last])
        self._demand(flag)
        self._is_cold = False
        self._x, _, self._flag, self._info = self._model.result()
        return timings

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows one after the other; timed are the new P and q and the solve from the last answer found."""
        p = self.program
        if self._flag > 0:
            self._last[:] = self._x
        flag, answers, nanoseconds = follow_rows(partial(face.daqp_follow, *self._problem(), self._last), p.P, p.q, rows, forgetting)
        self._demand(flag)
        self._is_cold = False
        self._x, _, self._flag, self._info = self._model.result()
        return answers, nanoseconds

    def _problem(self) -> tuple[Any, ...]:
        p = self.program
        return self._model.state, p.R, p.l, p.u, self._primal_tol, self._cold, self._sense
