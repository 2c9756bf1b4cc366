/* The functions of embedded.h by the C that CVXPYgen writes around OSQP. */
#include "cpg_solve.h"
#include "embedded.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* S with S'S = P, upper triangular; its row is zero if the pivot of P is zero to rounding. */
static void square_root(const double *P, double S[D][D])
{
    for (int i = 0; i < D; ++i) {
        double row[D];
        for (int j = i; j < D; ++j) {
            row[j] = P[i * D + j];
        }
        for (int k = 0; k < i; ++k) {
            for (int j = i; j < D; ++j) {
                row[j] -= S[k][i] * S[k][j];
            }
        }
        const double pivot = row[i] > D * DBL_EPSILON * P[i * D + i] ? 1 / sqrt(row[i]) : 0;
        for (int j = i; j < D; ++j) {
            S[i][j] = row[j] * pivot;
        }
    }
}

int embedded_setup(const double *lb, const double *ub, const double *settings)
{
    if (settings[0] > 0) {
        cpg_set_solver_eps_abs(settings[0]);
        cpg_set_solver_eps_rel(settings[0]);
        cpg_set_solver_max_iter(200000);
    }
    for (int k = 0; k < BELOW; ++k) {
        UPDATE_LOWER(k, lb[below[k]]);
    }
    for (int k = 0; k < ABOVE; ++k) {
        UPDATE_UPPER(k, ub[above[k]]);
    }
    return 0;
}

static int update(void *state, const double *P, const double *q)
{
    static double S[D][D];
    square_root(P, S);
    for (int i = 0, k = 0; i < D; ++i) {
        for (int j = i; j < D; ++j) {
            cpg_update_S(k++, S[i][j]);
        }
    }
    for (int i = 0; i < D; ++i) {
        cpg_update_q(i, q[i]);
    }
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    osqp_cold_start(&solver);
    cpg_solve();
    if (solver.info->status_val == OSQP_SOLVED) {
        memcpy(x, CPG_Result.prim->x, D * sizeof *x);
    }
    return OK;
}

const char *embedded_report(double *z, int *iterations)
{
    memset(z, 0, D * sizeof *z);
    for (int k = 0; k < BELOW; ++k) {
        z[below[k]] -= CPG_Result.dual->DUAL_LOWER[k];
    }
    for (int k = 0; k < ABOVE; ++k) {
        z[above[k]] += CPG_Result.dual->DUAL_UPPER[k];
    }
    *iterations = (int)CPG_Result.info->iter;
    return solver.info->status;
}

LIBRARY(embedded)
