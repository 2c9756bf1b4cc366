"""OSQP's own embedded C (``codegen``): ADMM with P and q that may change.

Source: G. Banjac, B. Stellato, N. Moehle, P. Goulart, A. Bemporad, S. Boyd, "Embedded code generation using the OSQP
solver", IEEE Conference on Decision and Control (2017).

Timed: ``update`` brings in the upper triangle of P and q, scales and factorises; ``solve`` iterates, cold from zero. The
penalty ρ that a solve has adapted stays for the next, as the library means it. Its adaptation is counted in steps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import osqp
from scipy.sparse import csc_matrix

from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape
from solvers.rows import Triangle


class Osqp(Embedded):
    """The files of ``osqp.OSQP.codegen`` with parameters "matrices"."""

    name = "osqp"
    algorithm = "ADMM"
    licence = "Apache-2.0"
    distribution = "osqp"
    warm_startable = True
    glue = r"""
#include <math.h>
#include "osqp.h"
#include "workspace.h"
#include "embedded.h"

static OSQPFloat triangle[D * (D + 1) / 2], low[BOUNDED], high[BOUNDED], zero_x[D], zero_y[BOUNDED];

void embedded_setup(const double *lb, const double *ub, const double *settings)
{
    if (settings[0] > 0) {
        OSQPSettings wanted = *solver.settings;
        wanted.eps_abs = settings[0];
        wanted.eps_rel = settings[0];
        wanted.max_iter = 200000;
        osqp_update_settings(&solver, &wanted);
    }
    for (int k = 0; k < BOUNDED; ++k) {
        low[k] = fmax(lb[bounded[k]], -OSQP_INFTY);
        high[k] = fmin(ub[bounded[k]], OSQP_INFTY);
    }
    osqp_update_data_vec(&solver, OSQP_NULL, low, high);
}

void embedded_update(const double *P, const double *q)
{
    for (int j = 0, k = 0; j < D; ++j) {
        for (int i = 0; i <= j; ++i) {
            triangle[k++] = P[j * D + i];
        }
    }
    osqp_update_data_mat(&solver, triangle, OSQP_NULL, D * (D + 1) / 2, OSQP_NULL, OSQP_NULL, 0);
    osqp_update_data_vec(&solver, q, OSQP_NULL, OSQP_NULL);
}

int embedded_solve(const double *start)
{
    if (start) {
        osqp_warm_start(&solver, start, OSQP_NULL);
    } else {
        osqp_warm_start(&solver, zero_x, zero_y);
    }
    osqp_solve(&solver);
    return solver.info->status_val != OSQP_SOLVED;
}

void embedded_answer(double *x)
{
    for (int i = 0; i < D; ++i) {
        x[i] = solver.solution->x[i];
    }
}

void embedded_multipliers(double *z)
{
    for (int i = 0; i < D; ++i) {
        z[i] = 0;
    }
    for (int k = 0; k < BOUNDED; ++k) {
        z[bounded[k]] = solver.solution->y[k];
    }
}

const char *embedded_status(void) { return solver.info->status; }

int embedded_iterations(void) { return (int)solver.info->iter; }
"""

    def generate(self, shape: Shape, folder: Path) -> Sources:  # noqa: D102
        # Only the pattern of the numbers matters, all of them are replaced; the rows are those of bounded variables.
        d, rows = shape.d, list(shape.bounded)
        P = Triangle(d).matrix(np.eye(d) + 1e-3)
        solver = osqp.OSQP()
        solver.setup(P, np.ones(d), csc_matrix(np.eye(d)[rows]), np.zeros(len(rows)), np.ones(len(rows)), verbose=False,
                     polishing=False, adaptive_rho=1, adaptive_rho_interval=50)
        solver.codegen(str(folder / "osqp"), parameters="matrices")
        written = folder / "osqp"
        return Sources((*sorted((written / "src").glob("*.c")), written / "workspace.c"),
                       tuple(f"-I{written / part}" for part in (".", "inc/public", "inc/private")))
