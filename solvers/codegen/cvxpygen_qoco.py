"""QOCO in C by CVXPYgen; the problem, its cost and what is timed stand in :mod:`solvers.codegen._cvxpygen`.

Source: G. M. Chari, B. Açıkmeşe, "QOCO: a quadratic objective conic optimizer with custom solver generation" (2025).
"""

from __future__ import annotations

from solvers.codegen._cvxpygen import GLUE, Cvxpygen


class CvxpygenQoco(Cvxpygen):
    """CVXPYgen with the solver QOCO."""

    name = "cvxpygen_qoco"
    backend = "QOCO"
    algorithm = "interior point"
    licence = "BSD-3-Clause"
    glue = GLUE.replace("FOUND", "CPG_Result.info->status == QOCO_SOLVED") + r"""
static void choose_tolerance(double tolerance)
{
    cpg_set_solver_abstol(tolerance);
    cpg_set_solver_reltol(tolerance);
}

static void forget(void) {}

const char *embedded_status(void)
{
    switch (CPG_Result.info->status) {
    case QOCO_SOLVED: return "solved";
    case QOCO_SOLVED_INACCURATE: return "solved inaccurately";
    case QOCO_MAX_ITER: return "maximum iterations reached";
    default: return "numerical problems";
    }
}
"""
