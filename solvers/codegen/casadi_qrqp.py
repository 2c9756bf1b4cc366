"""qrqp as CasADi writes it in C: primal-dual active set method with sparse QR factors.

    minimise ½ xᵀh x + gᵀx   subject to   lbx ≤ x ≤ ubx;   h = P, g = q

Source: J. A. E. Andersson, J. B. Rawlings, "Sensitivity analysis for nonlinear programming in CasADi", IFAC NMPC
(2018).

Timed: ``update`` copies P and q; ``solve`` is one call of the function, which sets up its work arrays each time.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi

from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape


class CasadiQrqp(Embedded):
    """``casadi.conic`` with the plugin qrqp through ``casadi.CodeGenerator``."""

    name = "casadi_qrqp"
    algorithm = "primal-dual active set"
    licence = "LGPL-3.0-or-later, the C MIT-0"
    distribution = "casadi"
    compiled_in = ("tolerance",)

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Those of the direct lane; each is built."""
        return ({"tolerance": 1e-8}, {"tolerance": 1e-12})

    glue = r"""
#include <string.h>
#include "qp.h"
#include "qp.c"
#include "places.h"
#include "embedded.h"

static double hessian[D * D], linear[D], low[D], high[D], answer[D], multipliers[D];
static const double *arguments[qp_SZ_ARG];
static double *results[qp_SZ_RES], reals[qp_SZ_W];
static casadi_int integers[qp_SZ_IW];
static int status;

void embedded_setup(const double *lb, const double *ub, const double *settings)
{
    memcpy(low, lb, sizeof low);
    memcpy(high, ub, sizeof high);
}

void embedded_update(const double *P, const double *q)
{
    memcpy(hessian, P, sizeof hessian);
    memcpy(linear, q, sizeof linear);
}

int embedded_solve(const double *start)
{
    /* The function moves these pointers on. */
    memset(arguments, 0, sizeof arguments);
    memset(results, 0, sizeof results);
    arguments[AT_H] = hessian;
    arguments[AT_G] = linear;
    arguments[AT_LBX] = low;
    arguments[AT_UBX] = high;
    results[AT_X] = answer;
    results[AT_LAM_X] = multipliers;
    status = qp(arguments, results, integers, reals, 0);
    return status;
}

void embedded_answer(double *x) { memcpy(x, answer, sizeof answer); }

void embedded_multipliers(double *z) { memcpy(z, multipliers, sizeof multipliers); }

const char *embedded_status(void) { return status == 0 ? "solved" : status == 4 ? "no search direction" : "not solved"; }

int embedded_iterations(void) { return -1; }
"""

    def generate(self, shape: Shape, folder: Path) -> Sources:  # noqa: D102
        d = shape.d
        tolerance = float(self.settings.get("tolerance", -1.0))
        tolerances = {"constr_viol_tol": tolerance, "dual_inf_tol": tolerance} if tolerance > 0.0 else {}
        function = casadi.conic("qp", "qrqp", {"h": casadi.Sparsity.dense(d, d), "a": casadi.Sparsity.dense(0, d)},
                                {"error_on_fail": False, "print_header": False, "print_iter": False, "print_info": False,
                                 **tolerances})
        writer = casadi.CodeGenerator("qp.c", {"with_header": True})
        writer.add(function)
        writer.generate(f"{folder}/")
        places = {name: function.index_in(name) for name in ("h", "g", "lbx", "ubx")}
        places |= {name: function.index_out(name) for name in ("x", "lam_x")}
        text = "enum { " + ", ".join(f"AT_{name.upper()} = {place}" for name, place in places.items()) + " };\n"
        (folder / "places.h").write_text(text, encoding="utf-8")
        return Sources(())
