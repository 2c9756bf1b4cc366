/* MuJoCo in the timed loop, by mju_boxQP as mujoco.h of the package mujoco-core 4.0.1 declares it. */
#include "library.h"

typedef struct {
    Data data;
    const double *lower, *upper;
    double *factor;
    int (*box_qp)(double *x, double *factor, int *index, const double *H, const double *g, int n, const double *lower,
                  const double *upper);
    int64_t free; /* number of free variables of the last answer, negative without one */
} State;

/* The library does not copy the data. */
static int update(void *state, const double *P, const double *q)
{
    set_data(state, P, q);
    return OK;
}

/* It starts from the contents of the array of its answer. */
static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    const int d = (int)s->data.d;
    for (int j = 0; j < d; ++j) {
        x[j] = start != NULL ? start[j] : 0;
    }
    s->free = s->box_qp(x, s->factor, NULL, s->data.P, s->data.q, d, s->lower, s->upper);
    for (int j = 0; s->free < 0 && j < d; ++j) {
        x[j] = NAN;
    }
    return OK;
}

LIBRARY(mujoco)
