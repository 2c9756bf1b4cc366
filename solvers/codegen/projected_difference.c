/* The functions of embedded.h by solvers/core/descent.h, in static memory. */
#include "descent.h"
#include "embedded.h"
#include "product.h"

static union {
    double number;
    char bytes[MEMORY_BYTES];
} memory __attribute__((aligned(64)));
static ProjectedGradient solver;
static double ratio;
static long steps;
static int refused = NOT_FINITE, status = NOT_FINITE; /* of set-up and update; at first without data */

int embedded_setup(const double *lb, const double *ub, const double *settings)
{
    steps = (long)settings[0];
    ratio = settings[1];
    status = NOT_FINITE;
    refused = descent_setup(&memory, D, lb, ub);
    solver = descent_at(&memory);
    return refused;
}

static int update(void *state, const double *P, const double *q)
{
    (void)state;
    status = refused != OK ? refused : descent_set_data(&solver, P, q, ratio, 0);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    (void)state;
    if (status == OK) {
        descent_start(&solver, start);
        projected_steps(&solver, steps, -1);
        descent_answer(&solver);
        memcpy(x, solver.answer, D * sizeof(double));
    }
    return OK;
}

const char *embedded_report(double *z, int *iterations)
{
    const double *const x = solver.answer;
    affine(solver.columns, solver.ld, D, solver.w, solver.shift, solver.next); /* -eta (P x + q) */
    for (int i = 0; i < D; ++i) {
        const double downhill = solver.next[i] / solver.head->eta, lower = solver.lb[i], upper = solver.ub[i];
        z[i] = (x[i] <= lower && (downhill < 0 || lower >= upper)) || (x[i] >= upper && downhill > 0) ? downhill : 0;
    }
    *iterations = (int)steps;
    return status == OK ? "all steps taken" : "P or q cannot be taken";
}

LIBRARY(embedded)
