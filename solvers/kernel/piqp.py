"""PIQP by its C functions: the algorithm and settings of the direct lane, see :mod:`solvers.direct.piqp`.

The package piqp does not export them; CasADi's wheel brings them in a library of version 0.6.3, built for any x86-64
processor, while the direct lane has code for AVX2 and AVX-512 as well.

Timed inside compiled code: ``update`` hands over P and q, which the library copies and equilibrates; ``solve`` is
``piqp_solve`` and the copy of its answer.
"""

import ctypes
import weakref
from dataclasses import replace

import numpy as np
from qpsolvers import Problem, Solution

from solvers import backend as known
from solvers.arrays import Vector, address
from solvers.kernel._library import CompiledLibrary, fields, folder, opened, vector
from solvers.rows import Program

IN_LOOP = ("piqp_update_dense", "piqp_solve")
PIQP = opened(
    "casadi",
    "3.8.2",
    folder("casadi") / "libpiqpc.so",
    ("piqp_set_default_settings_dense", "piqp_setup_dense", "piqp_cleanup", *IN_LOOP),
)
MAX_ITER_REACHED = -1
MESSAGES = {
    1: "PIQP_SOLVED",
    MAX_ITER_REACHED: "PIQP_MAX_ITER_REACHED",
    -2: "PIQP_PRIMAL_INFEASIBLE",
    -3: "PIQP_DUAL_INFEASIBLE",
    -8: "PIQP_NUMERICS",
    -9: "PIQP_UNSOLVED",
    -10: "PIQP_INVALID_SETTINGS",
}


class Settings(ctypes.Structure):
    """``piqp_settings``."""

    _fields_ = fields("""
        double rho_init, delta_init, eps_abs, eps_rel; int check_duality_gap; double eps_duality_gap_abs,
        eps_duality_gap_rel,
        infeasibility_threshold, reg_lower_limit, reg_finetune_lower_limit; int reg_finetune_primal_update_threshold,
        reg_finetune_dual_update_threshold, max_iter, max_factor_retires, preconditioner_scale_cost,
        preconditioner_reuse_on_update,
        preconditioner_iter; double tau; int kkt_solver, iterative_refinement_always_enabled; double
        iterative_refinement_eps_abs,
        iterative_refinement_eps_rel; int iterative_refinement_max_iter; double
        iterative_refinement_min_improvement_rate,
        iterative_refinement_static_regularization_eps, iterative_refinement_static_regularization_rel; int verbose,
        compute_timings;""")


class Data(ctypes.Structure):
    """``piqp_data_dense``; matrices row by row, NULL for what is not there."""

    _fields_ = fields("int n, p, m; double *P, *c, *A, *b, *G, *h_l, *h_u, *x_l, *x_u;")


class Result(ctypes.Structure):
    """``piqp_result``, and as far as it is read the ``piqp_info`` in it."""

    _fields_ = fields("""
        double *x, *y, *z_l, *z_u, *z_bl, *z_bu, *s_l, *s_u, *s_bl, *s_bu; int status, iter;""")


class Workspace(ctypes.Structure):
    """``piqp_workspace``."""

    _fields_ = (*fields("void *solver; int is_dense, n, p, m;"), ("result", ctypes.POINTER(Result)))


class Piqp(CompiledLibrary):
    """The library's dense solver."""

    name = "piqp"
    library = replace(known.PIQP, distribution="casadi")
    iteration_setting = "max_iter"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        settings, workspace = Settings(), ctypes.POINTER(Workspace)()
        PIQP.piqp_set_default_settings_dense(ctypes.byref(settings))
        self.choose(settings)
        A, G = p.R[p.equalities], p.R[p.inequalities]
        parts = (p.P, p.q, A, p.u[p.equalities], G, None, p.u[p.inequalities], p.l[p.bounds], p.u[p.bounds])
        data = Data(p.d, len(A), len(G), *(address(part) if part is not None and part.size else None for part in parts))
        PIQP.piqp_setup_dense(ctypes.byref(workspace), ctypes.byref(data), ctypes.byref(settings))
        weakref.finalize(self, PIQP.piqp_cleanup, workspace)
        self._workspace = workspace.contents
        self.bind(workspace, A if len(A) else 0, *(PIQP[name] for name in IN_LOOP))

    def read(self) -> None:  # noqa: D102
        self._result = self._workspace.result.contents

    def iterate(self) -> Vector | None:  # noqa: D102
        return vector(self._result.x, self.program.d) if self._result.status == MAX_ITER_REACHED else None

    def solution(self) -> Solution:  # noqa: D102
        r, p = self._result, self.program
        lower, upper = vector(r.z_bl, p.d), vector(r.z_bu, p.d)
        w = np.concatenate(
            [upper - lower, vector(r.y, len(p.R[p.equalities])), vector(r.z_u, len(p.R[p.inequalities]))]
        )
        return p.solution(self.x, w, self.found, status=MESSAGES[r.status], reported_us=None, iterations=r.iter)
