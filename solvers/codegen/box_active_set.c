/* The functions of embedded.h by solvers/core/box.h, in static memory. */
#include "box.h"
#include "embedded.h"

static union {
    double number;
    char bytes[MEMORY_BYTES];
} memory __attribute__((aligned(64)));
static Box solver;
static int refused = NOT_FINITE, taken = NOT_FINITE, status; /* of set-up, update and solve; at first without data */

int embedded_setup(const double *lb, const double *ub, const double *settings)
{
    (void)settings;
    taken = NOT_FINITE;
    refused = box_setup(&memory, D, lb, ub);
    solver = box_at(&memory);
    return refused;
}

static int update(void *state, const double *P, const double *q)
{
    (void)state;
    taken = refused != OK ? refused : box_set_data(&solver, P, q);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    (void)state;
    status = taken == OK && start != NULL ? box_start(&solver, start) : taken;
    status = status == OK ? box_solve(&solver, start != NULL) : status;
    if (status == OK) {
        memcpy(x, solver.answer, D * sizeof(double));
    }
    return OK;
}

const char *embedded_report(double *z, int *iterations)
{
    for (int i = 0; i < D; ++i) {
        z[i] = solver.side[i] == FREE ? 0 : -box_gradient(&solver, i);
    }
    *iterations = solver.head->exchanges;
    return status == OK ? "solved" : status == INDEFINITE ? "P is not positive semidefinite" : "not solved";
}

LIBRARY(embedded)
