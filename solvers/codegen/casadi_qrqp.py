"""qrqp as CasADi writes it in C: primal-dual active set method with sparse QR factors.

    minimise ½ xᵀh x + gᵀx   subject to   lbx ≤ x ≤ ubx;   h = P, g = q

Source: J. A. E. Andersson, J. B. Rawlings, "Sensitivity analysis for nonlinear programming in CasADi", IFAC NMPC
(2018).

Timed: ``update`` copies P and q; ``solve`` is one call of the function, which sets up its work arrays each time.
"""

from pathlib import Path

import casadi

from solvers.backend import Backend, relative
from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape


class CasadiQrqp(Embedded):
    """``casadi.conic`` with the plugin qrqp through ``casadi.CodeGenerator``."""

    library = Backend(
        "primal-dual active set", "LGPL-3.0-or-later, the C MIT-0", "casadi", {"tolerance": relative}, (8, 12)
    )
    compiled_in = ("tolerance",)

    def generate(self, shape: Shape, folder: Path) -> Sources:
        d = shape.d
        tolerance = float(self.settings.get("tolerance", -1.0))
        tolerances = {"constr_viol_tol": tolerance, "dual_inf_tol": tolerance} if tolerance > 0.0 else {}
        function = casadi.conic(
            "qp",
            "qrqp",
            {"h": casadi.Sparsity.dense(d, d), "a": casadi.Sparsity.dense(0, d)},
            {"error_on_fail": False, "print_header": False, "print_iter": False, "print_info": False, **tolerances},
        )
        writer = casadi.CodeGenerator("qp.c", {"with_header": True})
        writer.add(function)
        writer.generate(f"{folder}/")
        indices = {name: function.index_in(name) for name in ("h", "g", "lbx", "ubx")}
        indices |= {name: function.index_out(name) for name in ("x", "lam_x")}
        text = "enum { " + ", ".join(f"AT_{name.upper()} = {index}" for name, index in indices.items()) + " };\n"
        (folder / "indices.h").write_text(text, encoding="utf-8")
        return Sources(())
