/* The functions of embedded.h by the function qp that CasADi writes; indices.h has the indices of its arguments. */
#include <string.h>
#include "qp.h"
#include "qp.c"
#include "indices.h"
#include "embedded.h"

static double hessian[D * D], linear[D], low[D], high[D], answer[D], multipliers[D];
static const double *arguments[qp_SZ_ARG];
static double *results[qp_SZ_RES], reals[qp_SZ_W];
static casadi_int integers[qp_SZ_IW];
static int status;

int embedded_setup(const double *lb, const double *ub, const double *settings)
{
    memcpy(low, lb, sizeof low);
    memcpy(high, ub, sizeof high);
    return 0;
}

static int update(void *state, const double *P, const double *q)
{
    memcpy(hessian, P, sizeof hessian);
    memcpy(linear, q, sizeof linear);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    /* The function overwrites these pointers. */
    memset(arguments, 0, sizeof arguments);
    memset(results, 0, sizeof results);
    arguments[AT_H] = hessian;
    arguments[AT_G] = linear;
    arguments[AT_LBX] = low;
    arguments[AT_UBX] = high;
    results[AT_X] = answer;
    results[AT_LAM_X] = multipliers;
    status = qp(arguments, results, integers, reals, 0);
    if (status == 0) {
        memcpy(x, answer, sizeof answer);
    }
    return OK;
}

const char *embedded_report(double *z, int *iterations)
{
    memcpy(z, multipliers, sizeof multipliers);
    *iterations = -1;
    return status == 0 ? "solved" : status == 4 ? "no search direction" : "not solved";
}

LIBRARY(embedded)
