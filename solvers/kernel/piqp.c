/* PIQP in the timed loop, by the C interface of its version 0.6.3 in the package casadi 3.8.2. */
#include "library.h"

enum { PIQP_SOLVED = 1 };

typedef struct {
    void *solver;
    int is_dense, n, p, m;
    struct {
        const double *x;
    } *result;
} Workspace;

typedef struct {
    Data data;
    Workspace *workspace;
    double *A; /* equalities, or NULL */
    void (*update_dense)(Workspace *workspace, const double *P, const double *c, double *A, double *b, double *G,
                         double *h_l, double *h_u, double *x_l, double *x_u);
    int (*solve)(Workspace *workspace);
} State;

/* For a new P the library equilibrates again, but does not recompute A'A, so A is passed too. */
static int update(void *state, const double *P, const double *q)
{
    State *const s = state;
    take_data(&s->data, P, q);
    s->update_dense(s->workspace, P, q, s->A, NULL, NULL, NULL, NULL, NULL, NULL);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    (void)start; /* it has no warm start */
    if (s->solve(s->workspace) == PIQP_SOLVED) {
        memcpy(x, s->workspace->result->x, (size_t)s->data.d * sizeof(double));
    }
    return OK;
}

LIBRARY(piqp)
