"""SCS in C by CVXPYgen; the problem, its cost and what is timed stand in :mod:`solvers.codegen._cvxpygen`.

Source: B. O'Donoghue, "Operator splitting for a homogeneous embedding of the linear complementarity problem", SIAM
Journal on Optimization 31 (2021), pages 1999 to 2023. New data make a new workspace, for which the C allocates memory.
"""

from __future__ import annotations

from solvers.codegen._cvxpygen import GLUE, Cvxpygen


class CvxpygenScs(Cvxpygen):
    """CVXPYgen with the solver SCS."""

    name = "cvxpygen_scs"
    backend = "SCS"
    algorithm = "ADMM, Anderson acceleration"
    licence = "MIT"
    glue = GLUE.replace("FOUND", "Scs_Info.status_val == SCS_SOLVED") + r"""
static void choose_tolerance(double tolerance)
{
    cpg_set_solver_eps_abs(tolerance);
    cpg_set_solver_eps_rel(tolerance);
    cpg_set_solver_max_iters(1000000);
}

/* cpg_solve makes a new workspace for new data and would never give the old one back. */
static void forget(void)
{
    cpg_set_solver_warm_start(0);
    if (Scs_Work) {
        scs_finish(Scs_Work);
        Scs_Work = SCS_NULL;
    }
}

const char *embedded_status(void) { return Scs_Info.status; }
"""
