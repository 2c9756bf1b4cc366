"""DAQP by its C interface: the algorithm, settings and starts of the direct lane, see :mod:`solvers.direct.daqp`.

Timed inside compiled code: ``update`` is ``daqp_update_ldp`` with pointers to the new P and q, which the library does
not copy, and an empty active set; ``solve`` is ``daqp_solve`` and the copy of its answer, for a warm start after
``daqp_update_ldp`` with the rows that ``warm_start`` touches. The workspace is allocated once, in ``setup``.
"""

import ctypes
import weakref
from typing import Any

import daqp
import numpy as np

from solvers.adapter import Program, Report, Stack
from solvers.arrays import address
from solvers.direct import daqp as direct
from solvers.kernel._library import CompiledLibrary, open_library, structure

DAQP = open_library(
    "daqp",
    "0.11.0",
    daqp.__file__,
    (
        "daqp_default_settings",
        "setup_daqp_main",
        "daqp_update_ldp",
        "daqp_solve",
        "free_daqp_workspace",
        "free_daqp_ldp",
    ),
)

Settings = structure("""
    double primal_tol, dual_tol, zero_tol, pivot_tol, progress_tol; int cycle_tol, iter_limit; double fval_bound,
    eps_prox, eta_prox,
    rho_soft, rel_subopt, abs_subopt, sing_tol, refactor_tol, time_limit, w_soft; int eq_reduction, presolve;""")
"""``DAQPSettings``."""

QP = structure("int n, m, ms; double *H, *f, *A, *bupper, *blower; int *sense, *break_points, nh, problem_type;")
"""``DAQPProblem``."""

Workspace = structure("""
    void *qp; int n, m, ms; double *M, *dupper, *dlower, *Rinv, *v; int *sense; double *scaling, *RinvD, *x,
    *xold, *lam, *lam_star, *u,
    fval, *L, *D, *xldl, *zldl; int reuse_ind, *WS, n_active, iterations, sing_ind, *prox_mask, n_prox; double
    soft_slack;
    void *settings, *bnb; int outer_iter; void *hierarchy, *avi, *eq, *timer; double *Mu, *rho_ls, *rho_us, *w_ls,
    *w_us; int state;""")
"""``DAQPWorkspace``."""

Result = structure("double *x, *lam, fval, soft_slack; int exitflag, iter, nodes; double solve_time, setup_time;")
"""``DAQPResult``."""


class Daqp(CompiledLibrary, direct.Daqp):
    """The library's workspace."""

    def build(self, p: Program, rows: Stack) -> None:
        cold = direct.senses(p)
        settings, A = Settings(), p.R[p.general]
        DAQP.daqp_default_settings(ctypes.byref(settings))
        self.apply_settings(settings)
        data = (p.P, p.q, A, p.u, p.l, cold)
        qp = QP(p.d, p.u.size, p.d, *(address(array) if array.size else None for array in data))
        work = Workspace(settings=ctypes.addressof(settings))
        self.refuse(DAQP.setup_daqp_main(ctypes.byref(qp), ctypes.byref(work), None, 0))
        self._answer, self._lam = np.zeros(p.d), np.zeros(p.u.size)
        self._result = result = Result(address(self._answer), address(self._lam))
        self.pack_state(
            *map(ctypes.pointer, (qp, work, result)),
            DAQP.daqp_update_ldp,
            DAQP.daqp_solve,
            p.R,
            p.l,
            p.u,
            p.u.size,
            p.d,
            cold,
            cold.copy(),
            np.array([settings.primal_tol]),
            1,
        )
        weakref.finalize(self.state, _release, work, settings, qp, data)

    def report(self) -> Report:
        r = self._result
        return Report(r.exitflag > 0, self._lam, f"exit flag {r.exitflag}", r.iter, 1e6 * r.solve_time)


def _release(work: Any, *arrays: object) -> None:
    """Free the library's memory; the settings are ours, and ``arrays`` kept those behind its pointers alive."""
    work.settings = None
    DAQP.free_daqp_workspace(ctypes.byref(work))
    DAQP.free_daqp_ldp(ctypes.byref(work))
