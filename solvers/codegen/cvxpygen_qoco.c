/* QOCO behind CVXPYgen. */
#include "cvxpygen.h"

int found(void) { return CPG_Result.info->status == QOCO_SOLVED; }

void choose_tolerance(double tolerance)
{
    cpg_set_solver_abstol(tolerance);
    cpg_set_solver_reltol(tolerance);
}

void forget(void) {}

const char *embedded_status(void)
{
    switch (CPG_Result.info->status) {
    case QOCO_SOLVED:
        return "solved";
    case QOCO_SOLVED_INACCURATE:
        return "solved inaccurately";
    case QOCO_MAX_ITER:
        return "maximum iterations reached";
    default:
        return "numerical problems";
    }
}
