/* HPIPM in the timed loop, by the interface for dense programs of the library in the package casadi 3.8.2
 * (hpipm_d_dense_qp.h). */
#include "library.h"

enum { HPIPM_SUCCESS };

typedef struct {
    Data data;
    void *qp, *answer, *arguments, *workspace;
    void (*set_H)(const double *H, void *qp);
    void (*set_g)(const double *g, void *qp);
    void (*solve)(void *qp, void *answer, void *arguments, void *workspace);
    void (*get_status)(void *workspace, int *status);
    void (*get_v)(void *answer, double *x);
} State;

static int update(void *state, const double *P, const double *q)
{
    State *const s = state;
    set_data(&s->data, P, q);
    s->set_H(P, s->qp);
    s->set_g(q, s->qp);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    int status;
    (void)start; /* it cannot start from x alone */
    s->solve(s->qp, s->answer, s->arguments, s->workspace);
    s->get_status(s->workspace, &status);
    if (status == HPIPM_SUCCESS) {
        s->get_v(s->answer, x);
    }
    return OK;
}

LIBRARY(casadi_hpipm)
