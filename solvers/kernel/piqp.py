"""PIQP by its C functions: the algorithm and settings of the direct lane, see :mod:`solvers.direct.piqp`.

The package piqp does not export them; CasADi's wheel contains them in a library of version 0.6.3, built for any x86-64
processor, while the direct lane also has code for AVX2 and AVX-512.

Timed inside compiled code: ``update`` hands over P and q, which the library copies and equilibrates; ``solve`` is
``piqp_solve`` and the copy of its answer.
"""

import ctypes
import weakref
from dataclasses import replace

import numpy as np

from solvers.adapter import Answer, Program, Stack
from solvers.arrays import address
from solvers.backend import PIQP as LIBRARY
from solvers.kernel._library import CompiledLibrary, folder, open_library, structure, vector

IN_LOOP = ("piqp_update_dense", "piqp_solve")
PIQP = open_library(
    "casadi",
    "3.8.2",
    folder("casadi") / "libpiqpc.so",
    ("piqp_set_default_settings_dense", "piqp_setup_dense", "piqp_cleanup", *IN_LOOP),
)
MESSAGES = {
    1: "PIQP_SOLVED",
    -1: "PIQP_MAX_ITER_REACHED",
    -2: "PIQP_PRIMAL_INFEASIBLE",
    -3: "PIQP_DUAL_INFEASIBLE",
    -8: "PIQP_NUMERICS",
    -9: "PIQP_UNSOLVED",
    -10: "PIQP_INVALID_SETTINGS",
}

Settings = structure("""
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
"""``piqp_settings``."""

Data = structure("int n, p, m; double *P, *c, *A, *b, *G, *h_l, *h_u, *x_l, *x_u;")
"""``piqp_data_dense``; matrices row by row, NULL for absent ones."""

Result = structure("""
    double *x, *y, *z_l, *z_u, *z_bl, *z_bu, *s_l, *s_u, *s_bl, *s_bu; int status, iter;""")
"""``piqp_result`` with the beginning of its ``piqp_info``."""

Workspace = structure("void *solver; int is_dense, n, p, m;", result=ctypes.POINTER(Result))
"""``piqp_workspace``."""


class Piqp(CompiledLibrary):
    """The library's dense solver."""

    name = "piqp"
    library = replace(LIBRARY, distribution="casadi")
    iteration_setting = "max_iter"
    at_limit = ("PIQP_MAX_ITER_REACHED",)

    def build(self, p: Program, rows: Stack) -> None:
        settings, workspace = Settings(), ctypes.POINTER(Workspace)()
        PIQP.piqp_set_default_settings_dense(ctypes.byref(settings))
        self.choose(settings)
        parts = (p.P, p.q, p.A, p.b, p.G, None, p.h, p.lb, p.ub)
        addresses = (address(part) if part is not None and part.size else None for part in parts)
        data = Data(p.d, p.b.size, p.h.size, *addresses)
        PIQP.piqp_setup_dense(ctypes.byref(workspace), ctypes.byref(data), ctypes.byref(settings))
        weakref.finalize(self, PIQP.piqp_cleanup, workspace)
        self._workspace = workspace.contents
        self.bind(workspace, p.A if len(p.A) else 0, *(PIQP[name] for name in IN_LOOP))

    def answer(self) -> Answer:
        r, p = self._workspace.result.contents, self.program
        bounds = vector(r.z_bu, p.d) - vector(r.z_bl, p.d)
        w = np.concatenate([bounds, vector(r.y, p.b.size), vector(r.z_u, p.h.size)])
        return Answer(vector(r.x, p.d), w, MESSAGES[r.status], r.iter)
