/* MuJoCo's mju_boxQP in the timed loop, as version 4.0.1 declares it in mujoco.h; Python finds it (solvers/kernel/mujoco.py). */
#include "face_solvers.h"

#include <math.h>
#include <string.h>

typedef int BoxQP(double *res, double *R, int *index, const double *H, const double *g, int n, const double *lower, const double *upper);

typedef struct {
    BoxQP *box_qp;
    int d;
    const double *lower, *upper, *H, *g;
    double *factor;
    int *free; /* how many variables the last answer leaves free, below 0 where there is none */
} TimedMujoco;

/* The library reads the data where they are. */
static int update(void *solver, const double *P, const double *q)
{
    TimedMujoco *const t = solver;
    t->H = P;
    t->g = q;
    return OK;
}

/* It starts from its answer's array. */
static int solve(void *solver, const double *start, double *x)
{
    TimedMujoco *const t = solver;
    if (start != NULL) {
        memcpy(x, start, (size_t)t->d * sizeof(double));
    } else {
        memset(x, 0, (size_t)t->d * sizeof(double));
    }
    *t->free = t->box_qp(x, t->factor, NULL, t->H, t->g, t->d, t->lower, t->upper);
    for (int j = 0; *t->free < 0 && j < t->d; ++j) {
        x[j] = NAN;
    }
    return OK;
}

static TimedMujoco take_timed(Arguments *a)
{
    TimedMujoco t = {0};
    t.box_qp = (BoxQP *)(intptr_t)take_integer(a, 1, INT64_MAX);
    t.lower = take_array(a, VECTOR, ANY_LENGTH);
    t.d = (int)taken_length(a);
    t.upper = take_array(a, VECTOR, t.d);
    t.factor = take_output(a, t.d, t.d + 7);
    t.free = take_ints(a, 1);
    return t;
}

FACE(time_mujoco)
{
    TimedMujoco t = take_timed(a);
    const TimedSolver solver = {&t, t.d, update, solve};
    return finish_timed(a, &solver);
}

FACE(mujoco_follow)
{
    TimedMujoco t = take_timed(a);
    double *const last = take_output(a, VECTOR, t.d);
    const TimedSolver solver = {&t, t.d, update, solve};
    return finish_followed(a, &solver, last);
}
