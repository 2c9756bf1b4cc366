/* DAQP in the timed loop, by the C interface of the package daqp 0.11.0 (types.h, api.h), and the rows that a point
 * touches. */
#include "library.h"

#include "bindings.h"

enum { UPDATE_RINV = 1, UPDATE_V = 4, UPDATE_SENSE = 16 };

typedef struct {
    int n, m, ms; /* variables; rows, the first ms bounds */
    const double *H, *f;
    double *A, *bupper, *blower;
    int *sense;
} Problem;

typedef struct {
    double *x;
} Result;

typedef struct {
    const double *R, *l, *u; /* rows l <= R x <= u, the first d of R those of the identity */
    int64_t count, d;
} Rows;

typedef struct {
    Data data;
    Problem *problem;
    void *workspace;
    Result *result;
    int (*update)(int mask, void *workspace, Problem *problem);
    void (*solve)(Result *result, void *workspace);
    Rows rows;
    int *cold, *sense;
    const double *tolerance;
    int64_t is_cold;
} State;

/* DAQP's sense of each row at x: that of `cold` unless it is 0, else 1 at the upper side and 3 at the lower one. */
static void mark_active(const Rows *r, double tolerance, const double *x, const int *cold, int *sense)
{
    enum { AT_UPPER = 1, AT_LOWER = 3 };
    for (int64_t i = 0; i < r->count; ++i) {
        double value = i < r->d ? x[i] : 0;
        for (int64_t j = 0; i >= r->d && j < r->d; ++j) {
            value += r->R[i * r->d + j] * x[j];
        }
        sense[i] = cold[i] != 0                   ? cold[i]
                   : value <= r->l[i] + tolerance ? AT_LOWER
                   : value >= r->u[i] - tolerance ? AT_UPPER
                                                  : 0;
    }
}

#define BINDINGS(F)                                                                                                    \
    F(active_rows, "R[n,d], l[n], u[n], tolerance, x[d], cold[n]i, sense[n]i=",                                        \
      "mark the rows that x touches in DAQP's senses: 1 above, 3 below.", 0,                                           \
      mark_active(&(Rows){REALS(0), REALS(1), REALS(2), LENGTH(n), SIZE(d)}, NUMBER(3), REALS(4), MEMORY(5),           \
                  MEMORY(6)))
MAKE_BINDINGS(daqp)

/* The library does not copy the data. */
static int update_problem(State *s, int mask, int *sense)
{
    s->problem->H = s->data.P;
    s->problem->f = s->data.q;
    s->problem->sense = sense;
    return s->update(mask | UPDATE_SENSE, s->workspace, s->problem);
}

static int update(void *state, const double *P, const double *q)
{
    State *const s = state;
    set_data(&s->data, P, q);
    const int flag = update_problem(s, (P != NULL ? UPDATE_RINV : 0) | UPDATE_V, s->cold);
    s->is_cold = 1;
    return flag < 0 ? flag : OK;
}

/* Start from the rows that `start` touches, or from none; by default the library continues from its last active set. */
static int solve(void *state, const double *start, double *x)
{
    State *const s = state;
    if (start != NULL) {
        mark_active(&s->rows, *s->tolerance, start, s->cold, s->sense);
        update_problem(s, 0, s->sense);
    } else if (!s->is_cold) {
        update_problem(s, 0, s->cold);
    }
    s->is_cold = 0;
    s->solve(s->result, s->workspace);
    memcpy(x, s->result->x, (size_t)s->data.d * sizeof(double));
    return OK;
}

LIBRARY(daqp)
