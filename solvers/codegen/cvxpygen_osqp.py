"""OSQP in C by CVXPYgen; the problem, its cost and what is timed stand in :mod:`solvers.codegen._cvxpygen`.

Source: B. Stellato, G. Banjac, P. Goulart, A. Bemporad, S. Boyd, "OSQP: an operator splitting solver for quadratic
programs", Mathematical Programming Computation 12 (2020), pages 637 to 672.
"""

from __future__ import annotations

from solvers.codegen._cvxpygen import GLUE, Cvxpygen


class CvxpygenOsqp(Cvxpygen):
    """CVXPYgen with the solver OSQP."""

    name = "cvxpygen_osqp"
    backend = "OSQP"
    algorithm = "ADMM"
    glue = GLUE.replace("FOUND", "solver.info->status_val == OSQP_SOLVED") + r"""
static void choose_tolerance(double tolerance)
{
    cpg_set_solver_eps_abs(tolerance);
    cpg_set_solver_eps_rel(tolerance);
    cpg_set_solver_max_iter(200000);
}

static void forget(void) { osqp_cold_start(&solver); }

const char *embedded_status(void) { return solver.info->status; }
"""
