/* SCS behind CVXPYgen. */
#include "cvxpygen.h"

int found(void) { return Scs_Info.status_val == SCS_SOLVED; }

void choose_tolerance(double tolerance)
{
    cpg_set_solver_eps_abs(tolerance);
    cpg_set_solver_eps_rel(tolerance);
    cpg_set_solver_max_iters(1000000);
}

/* cpg_solve allocates a new workspace for new data and does not free the old one. */
void forget(void)
{
    cpg_set_solver_warm_start(0);
    if (Scs_Work) {
        scs_finish(Scs_Work);
        Scs_Work = SCS_NULL;
    }
}

const char *embedded_status(void) { return Scs_Info.status; }
