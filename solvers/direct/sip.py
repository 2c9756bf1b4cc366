"""SIP: interior point method for nonlinear programs, which asks for the model at every iterate.

    minimise f(x) = ½ xᵀP x + qᵀx   subject to   c(x) = A x − b = 0,  g(x) = G x − h ≤ 0

Source: J. Sousa-Pinto, the package sip_python.

Its tightest rung is near its limit: from 10⁻¹⁴·⁶ on it ends as SUBOPTIMAL, because rounding stops its steps.

Timed: ``setup`` orders the KKT matrix; ``update`` fills the second derivative; ``solve`` makes the library's object,
which keeps its iterates and so serves once, and iterates, with a call back into Python each time. There is no warm
start.
"""

from collections.abc import Callable

import numpy as np
import sip_python as sip
from scipy.sparse import csc_matrix, csr_matrix

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector
from solvers.backend import Backend, absolute, unscaled


class Sip(LibrarySolver):
    """The library's ``Solver``; the settings are its termination criteria."""

    library = Backend(
        "interior point",
        "MIT",
        "sip_python",
        {"max_complementarity_gap": absolute, "max_constraint_violation": unscaled, "max_dual_residual": unscaled},
        (4, 6, 8, 10, 12, 13, 14, 14.5),
    )
    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n, m = rows.equal, rows.unequal
        self._jacobians = A, G = csr_matrix(rows.R[:n]), csr_matrix(rows.R[n:])
        order, kkt, factor = sip.get_kkt_perm_inv_and_nnzs(csc_matrix(np.ones((p.d, p.d))), A, G, False)
        self._sizes, self._linear, self._options = sip.ProblemDimensions(), sip.QDLDLSettings(), sip.Settings()
        for size, value in {
            "x_dim": p.d,
            "s_dim": m,
            "y_dim": n,
            "jacobian_c_nnz": A.nnz,
            "jacobian_g_nnz": G.nnz,
            "upper_hessian_lagrangian_nnz": p.d * (p.d + 1) // 2,
            "kkt_nnz": kkt,
            "kkt_L_nnz": factor,
            "is_jacobian_c_transposed": True,
            "is_jacobian_g_transposed": True,
        }.items():
            setattr(self._sizes, size, value)
        self._linear.permute_kkt_system, self._linear.kkt_pinv = True, order
        for log in ("logs", "line_search_logs", "search_direction_logs", "derivative_check_logs"):
            setattr(self._options.logging, f"print_{log}", False)
        self.apply_settings(self._options.termination)
        self._hessian = p.triangle.matrix(p.P)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        self.program.triangle.fill(self._hessian, self.program.P)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._point = sip.Variables(self._sizes)
        self._point.x, self._point.y = np.zeros(self.program.d), np.zeros(self.rows.equal)
        self._point.s, self._point.z = np.ones(self.rows.unequal), np.ones(self.rows.unequal)
        model = _model(self.program, self.rows, self._hessian, *self._jacobians)
        self._report = sip.Solver(self._options, self._linear, self._sizes, model).solve(self._point)
        return np.array(self._point.x) if self._report.exit_status == sip.Status.SOLVED else None

    def report(self) -> Report:
        point, report = self._point, self._report
        return Report(point.x, np.concatenate([point.y, point.z]), report.exit_status.name, report.num_iterations)


def _model(p: Program, rows: Cones, hessian: csc_matrix, A: csr_matrix, G: csr_matrix) -> Callable:
    """The callback; it holds no reference to the solver, since the library would then never be freed."""
    out, n = sip.ModelCallbackOutput(), rows.equal
    out.jacobian_c, out.jacobian_g, out.upper_hessian_lagrangian = A, G, hessian

    def model(at: sip.ModelCallbackInput) -> sip.ModelCallbackOutput:
        x = np.asarray(at.x)
        Px, residual = p.P @ x, rows.R @ x - rows.r
        out.f, out.gradient_f = float(0.5 * x @ Px + p.q @ x), Px + p.q
        out.c, out.g = residual[:n], residual[n:]
        return out

    return model
