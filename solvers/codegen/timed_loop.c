/* The loop that times every compiled solver, round the functions of embedded.h. */
#include "../core/timed_calls.h"

#include "embedded.h"

static int update(void *solver, const double *P, const double *q)
{
    (void)solver;
    embedded_update(P, q);
    return OK;
}

static int solve(void *solver, const double *start, double *x)
{
    (void)solver;
    if (embedded_solve(start) == 0) {
        embedded_answer(x);
    }
    return OK;
}

/* As time_calls. */
int embedded_time(int64_t count, const double *P, const double *q, const double *start, int64_t most_ns,
                  int64_t *updates, int64_t *solves, double *answers, int64_t *made)
{
    const TimedSolver solver = {NULL, D, update, solve};
    return time_calls(&solver, count, P, q, start, most_ns, updates, solves, answers, made);
}
