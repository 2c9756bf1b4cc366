"""A solver in a file of one's own, of an installed library: CasADi's qrqp, a primal-dual active set method with sparse
QR factors. ``piezobench race --solver casadi_qrqp.py`` races it.

    minimise ½ xᵀh x + gᵀx   subject to   lba ≤ a x ≤ uba,  lbx ≤ x ≤ ubx;   h = P, g = q, a = (A; G)

Source: J. A. E. Andersson, J. B. Rawlings, "Sensitivity analysis for nonlinear programming in CasADi", IFAC NMPC
(2018).

Timed: ``setup`` makes the function; ``solve`` is a call of it, which converts the arrays. Its active set would start
from multipliers, which a warm start does not have. On bounds it is exact; with general rows it gives up often, and
sometimes calls an answer solved whose dual residual is 1e-2.
"""

import casadi
import numpy as np

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector
from solvers.backend import Backend, relative

QUIET = {"error_on_fail": False, "print_header": False, "print_iter": False, "print_info": False}


class CasadiQrqp(LibrarySolver):
    """``casadi.conic`` with the plugin qrqp."""

    name = "casadi_qrqp"
    library = Backend(
        "primal-dual active set",
        "LGPL-3.0-or-later",
        "casadi",
        {"constr_viol_tol": relative, "dual_inf_tol": relative},
        (8, 12),
    )

    def build(self, p: Program, rows: Stack) -> None:
        """Make the function for dense matrices of these sizes."""
        shapes = {"h": casadi.Sparsity.dense(p.d, p.d), "a": casadi.Sparsity.dense(len(p.l[p.general]), p.d)}
        self._function = casadi.conic("qp", "qrqp", shapes, {**QUIET, **self.settings})

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        """Call the function with the program's arrays."""
        p, g = self.program, self.program.general
        data = {"h": p.P, "g": p.q, "a": p.R[g], "lba": p.l[g], "uba": p.u[g], "lbx": p.lb, "ubx": p.ub}
        self._result = self._function(**{name: array for name, array in data.items() if array.size})
        return self._array("x")

    def _array(self, name: str) -> Vector:
        return self._result[name].full().ravel()

    def report(self) -> Report:
        """Its multipliers have the signs of ours."""
        w, stats = np.concatenate([self._array("lam_x"), self._array("lam_a")]), self._function.stats()
        return Report(stats["success"], w, stats["return_status"], stats["iter_count"])
