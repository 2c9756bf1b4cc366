/* The loop that times the updates and solves of every solver in the compiled lanes, ours and those of other libraries.
 *
 * A time includes one reading of the clock and no call from Python. Each call gets its own P and q.
 */
#ifndef CORE_TIMED_CALLS_H
#define CORE_TIMED_CALLS_H

#include "clock.h"
#include "status.h"

#include <stddef.h>

typedef struct {
    void *solver;
    int d;
    /* Take P (d, d), NULL for that of before, and q (d), which remain in memory until the next update. */
    int (*update)(void *solver, const double *P, const double *q);
    /* Solve, from `start` (d) or cold if that is NULL, and copy the answer to x (d), which stays as it is without one.
     */
    int (*solve)(void *solver, const double *start, double *x);
} TimedSolver;

/* Make one call for each of P (count, d, d), NULL for one that stays, and q (count, d), until most_ns are spent or a
 * status is neither OK nor CAPPED; `made` is the number of calls. Returns the last status. */
static inline int time_calls(const TimedSolver *s, int64_t count, const double *P, const double *q, const double *start,
                             int64_t most_ns, int64_t *update_ns, int64_t *solve_ns, double *answers, int64_t *made)
{
    const size_t d = (size_t)s->d;
    int64_t k = 0;
    int status = OK;
    while (k < count && most_ns >= 0 && (status == OK || status == CAPPED)) {
        const int64_t begin = monotonic_ns();
        status = s->update(s->solver, P == NULL ? P : P + (size_t)k * d * d, q + (size_t)k * d);
        const int64_t between = monotonic_ns();
        if (status == OK) {
            status = s->solve(s->solver, start, answers + (size_t)k * d);
        }
        const int64_t end = monotonic_ns();
        update_ns[k] = between - begin;
        solve_ns[k] = end - between;
        most_ns -= end - begin;
        ++k;
    }
    *made = k;
    return status;
}

#endif
