/* The functions of embedded.h by the files that OSQP writes; workspace.h has its solver. */
#include <math.h>
#include <string.h>
#include "osqp.h"
#include "workspace.h"
#include "embedded.h"

static OSQPFloat triangle[D * (D + 1) / 2], low[BOUNDED], high[BOUNDED], zero_x[D], zero_y[BOUNDED];

int embedded_setup(const double *lb, const double *ub, const double *settings)
{
    if (settings[0] > 0) {
        OSQPSettings wanted = *solver.settings;
        wanted.eps_abs = settings[0];
        wanted.eps_rel = settings[0];
        wanted.max_iter = 200000;
        osqp_update_settings(&solver, &wanted);
    }
    for (int k = 0; k < BOUNDED; ++k) {
        low[k] = fmax(lb[bounded[k]], -OSQP_INFTY);
        high[k] = fmin(ub[bounded[k]], OSQP_INFTY);
    }
    osqp_update_data_vec(&solver, OSQP_NULL, low, high);
    return 0;
}

static int update(void *state, const double *P, const double *q)
{
    for (int j = 0, k = 0; j < D; ++j) {
        for (int i = 0; i <= j; ++i) {
            triangle[k++] = P[j * D + i];
        }
    }
    osqp_update_data_mat(&solver, triangle, OSQP_NULL, D * (D + 1) / 2, OSQP_NULL, OSQP_NULL, 0);
    osqp_update_data_vec(&solver, q, OSQP_NULL, OSQP_NULL);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    if (start) {
        osqp_warm_start(&solver, start, OSQP_NULL);
    } else {
        osqp_warm_start(&solver, zero_x, zero_y);
    }
    osqp_solve(&solver);
    if (solver.info->status_val == OSQP_SOLVED) {
        memcpy(x, solver.solution->x, D * sizeof *x);
    }
    return OK;
}

const char *embedded_report(double *z, int *iterations)
{
    memset(z, 0, D * sizeof *z);
    for (int k = 0; k < BOUNDED; ++k) {
        z[bounded[k]] = solver.solution->y[k];
    }
    *iterations = (int)solver.info->iter;
    return solver.info->status;
}

LIBRARY(embedded)
