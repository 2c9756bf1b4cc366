"""ECOS in C by CVXPYgen; the problem, its cost and what is timed stand in :mod:`solvers.codegen._cvxpygen`.

Source: A. Domahidi, E. Chu, S. Boyd, "ECOS: an SOCP solver for embedded systems", European Control Conference (2013).
"""

from __future__ import annotations

from solvers.codegen._cvxpygen import GLUE, Cvxpygen


class CvxpygenEcos(Cvxpygen):
    """CVXPYgen with the solver ECOS."""

    name = "cvxpygen_ecos"
    backend = "ECOS"
    algorithm = "interior point"
    licence = "GPL-3.0-or-later"
    glue = GLUE.replace("FOUND", "CPG_Result.info->status == ECOS_OPTIMAL") + r"""
static void choose_tolerance(double tolerance)
{
    cpg_set_solver_abstol(tolerance);
    cpg_set_solver_reltol(tolerance);
    cpg_set_solver_feastol(tolerance);
}

static void forget(void) {}

const char *embedded_status(void)
{
    switch (CPG_Result.info->status) {
    case ECOS_OPTIMAL: return "optimal";
    case ECOS_PINF: return "primal infeasible";
    case ECOS_DINF: return "dual infeasible";
    case ECOS_MAXIT: return "maximum iterations reached";
    case ECOS_OPTIMAL + ECOS_INACC_OFFSET: return "close to optimal";
    default: return "numerical problems";
    }
}
"""
