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

void embedded_update(const double *P, const double *q)
{
    taken = refused != OK ? refused : box_set_data(&solver, P, q);
}

int embedded_solve(const double *start)
{
    status = taken == OK && start != NULL ? box_start(&solver, start) : taken;
    status = status == OK ? box_solve(&solver, start != NULL) : status;
    return status;
}

void embedded_answer(double *x) { memcpy(x, solver.answer, D * sizeof(double)); }

void embedded_multipliers(double *z)
{
    for (int i = 0; i < D; ++i) {
        z[i] = solver.side[i] == FREE ? 0 : -box_gradient(&solver, i);
    }
}

const char *embedded_status(void)
{
    return status == OK ? "solved" : status == INDEFINITE ? "P is not positive semidefinite" : "not solved";
}

int embedded_iterations(void) { return solver.head->exchanges; }
