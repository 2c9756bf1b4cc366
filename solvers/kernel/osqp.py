"""OSQP by its C functions: the algorithm, settings and starts of the direct lane, see :mod:`solvers.direct.osqp`.

Timed inside compiled code: ``update`` copies q and the upper triangle of P into the library, which scales and
factorises; ``solve`` is ``osqp_solve`` after a cold start or one from ``warm_start``, and the copy of its answer.
"""

import ctypes
import weakref

import numpy as np
from osqp import ext_builtin
from scipy.sparse import csc_matrix

from solvers.adapter import Answer, Intervals, Program
from solvers.arrays import address
from solvers.direct import osqp as direct
from solvers.kernel._library import CompiledLibrary, fields, open_library, structure, vector

IN_LOOP = ("osqp_update_data_vec", "osqp_update_data_mat", "osqp_warm_start", "osqp_cold_start", "osqp_solve")
OSQP = open_library(
    "osqp", "1.1.3", ext_builtin.__file__, ("osqp_set_default_settings", "osqp_setup", "osqp_cleanup", *IN_LOOP)
)
INFINITY = 1e30

Settings = structure("""
    int device, linsys_solver, allocate_solution, verbose, profiler_level, warm_starting, scaling, polishing;
    double rho; int rho_is_vec;
    double sigma, alpha; int cg_max_iter, cg_tol_reduction; double cg_tol_fraction; int cg_precond, adaptive_rho,
    adaptive_rho_interval;
    double adaptive_rho_fraction, adaptive_rho_tolerance; int max_iter; double eps_abs, eps_rel, eps_prim_inf,
    eps_dual_inf;
    int scaled_termination, check_termination, check_dualgap; double time_limit, delta; int polish_refine_iter;""")
"""``OSQPSettings``."""

Matrix = structure("int m, n; int *p, *i; double *x; int nzmax, nz, owned;")
"""``OSQPCscMatrix``; nz is -1 for compressed columns."""


class Info(ctypes.Structure):
    """``OSQPInfo``."""

    _fields_ = (
        ("status", ctypes.c_char * 32),
        *fields("""
        int status_val, status_polish; double obj_val, dual_obj_val, prim_res, dual_res, duality_gap; int iter,
        rho_updates;
        double rho_estimate, setup_time, solve_time;"""),
    )


Solver = structure("void *settings;", solution=ctypes.POINTER(ctypes.c_void_p * 2), info=ctypes.POINTER(Info))
"""``OSQPSolver``, and the beginning of its ``OSQPSolution``."""


def compressed(matrix: csc_matrix) -> ctypes.Structure:
    """A view of a matrix that lives at least as long."""
    m, n = matrix.shape
    return Matrix(m, n, *(part.ctypes.data for part in (matrix.indptr, matrix.indices, matrix.data)), matrix.nnz, -1, 0)


class Osqp(CompiledLibrary, direct.Osqp):
    """The library's ``OSQPSolver``."""

    def build(self, p: Program, rows: Intervals) -> None:
        settings, solver = Settings(), ctypes.POINTER(Solver)()
        OSQP.osqp_set_default_settings(ctypes.byref(settings))
        self.choose(settings, verbose=0)
        P, R = p.triangle.matrix(p.P), csc_matrix(rows.R)
        low, high = np.maximum(rows.l, -INFINITY), np.minimum(rows.u, INFINITY)
        self.refuse(
            -OSQP.osqp_setup(
                ctypes.byref(solver),
                ctypes.byref(compressed(P)),
                address(p.q),
                ctypes.byref(compressed(R)),
                address(low),
                address(high),
                low.size,
                p.d,
                ctypes.byref(settings),
            )
        )
        weakref.finalize(self, OSQP.osqp_cleanup, solver)
        self._library = solver.contents
        self.bind(P.data, solver, *(OSQP[name] for name in IN_LOOP))

    def answer(self) -> Answer:
        info, (x, y) = self._library.info.contents, self._library.solution.contents
        sizes = self.program.d, self.rows.l.size
        return Answer(vector(x, sizes[0]), vector(y, sizes[1]), info.status.decode(), info.iter, 1e6 * info.solve_time)
