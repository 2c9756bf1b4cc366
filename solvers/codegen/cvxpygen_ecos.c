/* ECOS behind CVXPYgen. */
#include "cvxpygen.h"

int found(void) { return CPG_Result.info->status == ECOS_OPTIMAL; }

void choose_tolerance(double tolerance)
{
    cpg_set_solver_abstol(tolerance);
    cpg_set_solver_reltol(tolerance);
    cpg_set_solver_feastol(tolerance);
}

void forget(void) {}

const char *embedded_status(void)
{
    switch (CPG_Result.info->status) {
    case ECOS_OPTIMAL:
        return "optimal";
    case ECOS_PINF:
        return "primal infeasible";
    case ECOS_DINF:
        return "dual infeasible";
    case ECOS_MAXIT:
        return "maximum iterations reached";
    case ECOS_OPTIMAL + ECOS_INACC_OFFSET:
        return "close to optimal";
    default:
        return "numerical problems";
    }
}
