/* The timed loops and their arguments, which are the last ones of every function that times a solver. */
#ifndef CORE_BINDINGS_TIMED_H
#define CORE_BINDINGS_TIMED_H

#include "bindings.h"
#include "forgetting.h"
#include "timed_calls.h"

#include <string.h>

/* time_calls on a solver of d variables with these arguments, numbered from i; returns the last status. */
#define TIMED "q[n,d], P[n,dd], start[d]?, most_ns#0:, updates[n]q=, solves[n]q=, answers[n,d]=, made[1]q="
#define TIMED_BY(i, solver)                                                                                            \
    time_calls(solver, LENGTH(n), REALS(i + 1), REALS(i), REALS(i + 2), WHOLE(i + 3), WHOLES(i + 4), WHOLES(i + 5),    \
               REALS(i + 6), WHOLES(i + 7))
/* The same for follow_rows. */
#define FOLLOWED "P[d,d]=, q[d]=, rows[n,d+1], forgetting, answers[n,d]=, nanoseconds[n]q="
#define FOLLOWED_BY(i, solver, last)                                                                                   \
    follow_rows(solver, LENGTH(n), REALS(i), REALS(i + 1), REALS(i + 2), NUMBER(i + 3), REALS(i + 4), WHOLES(i + 5),   \
                last)

/* Absorb rows (xi, x) into P and q, update and solve after each; only update and solve are timed. A solve continues
 * from the solver's state, or starts from `last` (d), the last answer, if that is not NULL. Returns the last status. */
static inline int follow_rows(const TimedSolver *solver, int64_t count, double *P, double *q, const double *rows,
                              double forgetting, double *answers, int64_t *nanoseconds, double *last)
{
    const int d = solver->d;
    double c = 0;
    int status = OK;
    for (int64_t k = 0; k < count && (status == OK || status == CAPPED); ++k) {
        double *const answer = answers + k * d;
        absorb(P, q, &c, d, rows + k * (d + 1), forgetting);
        const int64_t begin = monotonic_ns();
        status = solver->update(solver->solver, P, q);
        if (status == OK) {
            status = solver->solve(solver->solver, last, answer);
        }
        nanoseconds[k] = monotonic_ns() - begin;
        if (last != NULL && answer[0] == answer[0]) { /* NaN: no answer */
            memcpy(last, answer, (size_t)d * sizeof(double));
        }
    }
    return status;
}

#endif
