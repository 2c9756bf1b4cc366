"""QOCOGEN: an interior point method whose factorisation is written out for the pattern of one problem.

    minimise ½ xᵀP x + qᵀx   subject to   G x ≤ h;   rows of G: −x_i for lower and x_i for upper bounds

Source: G. M. Chari, B. Açıkmeşe, "QOCO: a quadratic objective conic optimizer with custom solver generation" (2025).

Timed: ``update`` copies the upper triangle of P and q; ``solve`` factorises in each of its steps.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import qocogen
from scipy.sparse import csc_matrix

from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape


class Qocogen(Embedded):
    """``qocogen.generate_solver``."""

    name = "qocogen"
    algorithm = "interior point"
    licence = "BSD-3-Clause"
    distribution = "qocogen"
    glue = r"""
#include "qoco_custom.h"
#include "embedded.h"

static Workspace work;

void embedded_setup(const double *lb, const double *ub, const double *settings)
{
    double right[BELOW + ABOVE];
    set_default_settings(&work);
    if (settings[0] > 0) {
        work.settings.abstol = settings[0];
        work.settings.reltol = settings[0];
    }
    load_data(&work);
    for (int k = 0; k < BELOW; ++k) {
        right[k] = -lb[below[k]];
    }
    for (int k = 0; k < ABOVE; ++k) {
        right[BELOW + k] = ub[above[k]];
    }
    update_h(&work, right);
}

void embedded_update(const double *P, const double *q)
{
    for (int j = 0, k = 0; j < D; ++j) {
        for (int i = 0; i <= j; ++i) {
            work.P[k++] = P[j * D + i];
        }
    }
    update_c(&work, (double *)q);
}

int embedded_solve(const double *start)
{
    qoco_custom_solve(&work);
    return work.sol.status != QOCO_CUSTOM_SOLVED;
}

void embedded_answer(double *x)
{
    for (int i = 0; i < D; ++i) {
        x[i] = work.sol.x[i];
    }
}

void embedded_multipliers(double *z)
{
    for (int i = 0; i < D; ++i) {
        z[i] = 0;
    }
    for (int k = 0; k < BELOW; ++k) {
        z[below[k]] -= work.sol.z[k];
    }
    for (int k = 0; k < ABOVE; ++k) {
        z[above[k]] += work.sol.z[BELOW + k];
    }
}

const char *embedded_status(void) { return QOCO_CUSTOM_SOLVE_STATUS_MESSAGE[work.sol.status]; }

int embedded_iterations(void) { return work.sol.iters; }
"""

    def generate(self, shape: Shape, folder: Path) -> Sources:  # noqa: D102
        # Only the pattern of the numbers matters: P, q and h are replaced.
        d, rows = shape.d, len(shape.below) + len(shape.above)
        G = csc_matrix(np.vstack([-np.eye(d)[list(shape.below)], np.eye(d)[list(shape.above)]]))
        with contextlib.redirect_stdout(io.StringIO()):
            qocogen.generate_solver(d, rows, 0, csc_matrix(np.triu(np.eye(d) + 1e-3)), np.ones(d), None, None, G, np.ones(rows), rows, 0,
                                    None, output_dir=str(folder), name="qoco")
        written = folder / "qoco"
        return Sources(tuple(path for path in sorted(written.glob("*.c")) if path.name != "runtest.c"), (f"-I{written}",))
