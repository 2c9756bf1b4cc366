/* quadprog in the timed loop, by the one C function of the package quadprog 0.1.14. */
#include "library.h"

typedef struct {
    Data data;
    double *G, *a, *lagrangian, *C, *b, *work; /* the function overwrites G and a */
    int *active, *iterations;
    int64_t rows, equal;
    int (*solve)(double *G, double *a, int n, double *x, double *lagrangian, double *cost, double *C, double *b,
                 int rows, int equal, int *active, int *active_count, int *iterations, double *work, int is_factorised);
    int64_t flag;
} State;

static int update(void *state, const double *P, const double *q)
{
    set_data(state, P, q);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    const int d = (int)s->data.d;
    double cost;
    int count;
    (void)start; /* it has no warm start */
    memcpy(s->G, s->data.P, (size_t)d * (size_t)d * sizeof(double));
    for (int j = 0; j < d; ++j) {
        s->a[j] = -s->data.q[j];
    }
    s->flag = s->solve(s->G, s->a, d, x, s->lagrangian, &cost, s->C, s->b, (int)s->rows, (int)s->equal, s->active,
                       &count, s->iterations, s->work, 0);
    for (int j = 0; s->flag != 0 && j < d; ++j) {
        x[j] = NAN;
    }
    return OK;
}

LIBRARY(quadprog)
