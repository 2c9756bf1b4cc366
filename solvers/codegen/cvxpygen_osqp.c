/* OSQP behind CVXPYgen. */
#include "cvxpygen.h"

int found(void) { return solver.info->status_val == OSQP_SOLVED; }

void choose_tolerance(double tolerance)
{
    cpg_set_solver_eps_abs(tolerance);
    cpg_set_solver_eps_rel(tolerance);
    cpg_set_solver_max_iter(200000);
}

void forget(void) { osqp_cold_start(&solver); }

const char *embedded_status(void) { return solver.info->status; }
