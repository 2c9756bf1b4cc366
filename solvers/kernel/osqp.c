/* OSQP in the timed loop, by the C interface of the package osqp 1.1.3 (osqp_api_types.h, osqp_api_functions.h). */
#include "library.h"

enum { OSQP_SOLVED = 1 };

typedef struct {
    void *settings;
    struct {
        const double *x;
    } *solution;
    struct {
        char status[32];
        int status_val;
    } *info;
} OSQPSolver;

typedef struct {
    Data data;
    double *triangle;
    OSQPSolver *solver;
    int (*update_data_vec)(OSQPSolver *solver, const double *q, const double *l, const double *u);
    int (*update_data_mat)(OSQPSolver *solver, const double *Px, const int *Pi, int P_n, const double *Ax,
                           const int *Ai, int A_n);
    int (*warm_start)(OSQPSolver *solver, const double *x, const double *y);
    void (*cold_start)(OSQPSolver *solver);
    int (*solve)(OSQPSolver *solver);
} State;

/* In the order of the library's own interface: q first, then P. */
static int update(void *state, const double *P, const double *q)
{
    State *const s = state;
    const int d = (int)s->data.d;
    take_data(&s->data, P, q);
    upper_triangle(&s->data, s->triangle);
    int flag = s->update_data_vec(s->solver, q, NULL, NULL);
    flag = flag != 0 ? flag : s->update_data_mat(s->solver, s->triangle, NULL, d * (d + 1) / 2, NULL, NULL, 0);
    return flag != 0 ? -flag : OK;
}

static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    if (start != NULL) {
        s->warm_start(s->solver, start, NULL);
    } else {
        s->cold_start(s->solver);
    }
    s->solve(s->solver);
    if (s->solver->info->status_val == OSQP_SOLVED) {
        memcpy(x, s->solver->solution->x, (size_t)s->data.d * sizeof(double));
    }
    return OK;
}

LIBRARY(osqp)
