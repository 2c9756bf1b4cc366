/* The functions of embedded.h by the files that QOCOGEN writes. */
#include <string.h>
#include "qoco_custom.h"
#include "embedded.h"

static Workspace work;

int embedded_setup(const double *lb, const double *ub, const double *settings)
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
    return 0;
}

static int update(void *state, const double *P, const double *q)
{
    for (int j = 0, k = 0; j < D; ++j) {
        for (int i = 0; i <= j; ++i) {
            work.P[k++] = P[j * D + i];
        }
    }
    update_c(&work, (double *)q);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    qoco_custom_solve(&work);
    if (work.sol.status == QOCO_CUSTOM_SOLVED) {
        memcpy(x, work.sol.x, D * sizeof *x);
    }
    return OK;
}

const char *embedded_report(double *z, int *iterations)
{
    memset(z, 0, D * sizeof *z);
    for (int k = 0; k < BELOW; ++k) {
        z[below[k]] -= work.sol.z[k];
    }
    for (int k = 0; k < ABOVE; ++k) {
        z[above[k]] += work.sol.z[BELOW + k];
    }
    *iterations = work.sol.iters;
    return QOCO_CUSTOM_SOLVE_STATUS_MESSAGE[work.sol.status];
}

LIBRARY(embedded)
