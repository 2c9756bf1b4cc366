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

void embedded_update(const double *P, const double *q)
{
    memcpy(hessian, P, sizeof hessian);
    memcpy(linear, q, sizeof linear);
}

int embedded_solve(const double *start)
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
    return status;
}

void embedded_answer(double *x) { memcpy(x, answer, sizeof answer); }

void embedded_multipliers(double *z) { memcpy(z, multipliers, sizeof multipliers); }

const char *embedded_status(void)
{
    return status == 0 ? "solved" : status == 4 ? "no search direction" : "not solved";
}

int embedded_iterations(void) { return -1; }
