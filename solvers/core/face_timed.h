/* The arguments of the timed loops, which are the last ones of every function that times a solver. */
#ifndef CORE_FACE_TIMED_H
#define CORE_FACE_TIMED_H

#include "face.h"
#include "forgetting.h"
#include "timed_calls.h"

#include <string.h>

#define TIMED "P, q, start, most_ns, updates, solves, answers"
#define FOLLOWED "P, q, rows, forgetting, answers, nanoseconds"
enum { TIMED_COUNT = 7, FOLLOWED_COUNT = 6 };

/* Take them, P as (n, d * d), and run the loop: the last status, and how many calls were made. */
static inline PyObject *finish_timed(Arguments *a, const TimedSolver *solver)
{
    const int d = solver->d;
    const double *const P = take_array(a, ANY_LENGTH, (Py_ssize_t)d * d);
    const Py_ssize_t count = taken_length(a);
    const double *const q = take_array(a, count, d);
    const double *const start = take_optional(a, VECTOR, d);
    const int64_t most_ns = take_integer(a, 0, INT64_MAX);
    int64_t *const update_ns = take_integers(a, count);
    int64_t *const solve_ns = take_integers(a, count);
    double *const answers = take_output(a, count, d);
    int64_t made;
    int status;
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, 1);
    made = time_calls(solver, count, P, q, start, most_ns, update_ns, solve_ns, answers, &status);
    end_long(a);
    return finish(a, Py_BuildValue("(in)", status, (Py_ssize_t)made));
}

/* Take them, and absorb rows (xi, x) into P and q, with a call after each; timed is all but the row. A solve starts
 * where the solver stands, or from `last` (d), which becomes its answer, where that is not NULL. The last status. */
static inline PyObject *finish_followed(Arguments *a, const TimedSolver *solver, double *last)
{
    const int d = solver->d;
    double *const P = take_output(a, d, d);
    double *const q = take_output(a, VECTOR, d);
    const double *const rows = take_array(a, ANY_LENGTH, d + 1);
    const Py_ssize_t length = taken_length(a);
    const double forgetting = take_number(a);
    double *const answers = take_output(a, length, d);
    int64_t *const nanoseconds = take_integers(a, length);
    double c = 0;
    int status = OK;
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, 1);
    for (Py_ssize_t k = 0; k < length && (status == OK || status == CAPPED); ++k) {
        double *const answer = answers + k * d;
        int64_t begin;
        absorb(P, q, &c, d, rows + k * (d + 1), forgetting);
        begin = monotonic_ns();
        status = solver->update(solver->solver, P, q);
        if (status == OK) {
            status = solver->solve(solver->solver, last, answer);
        }
        nanoseconds[k] = monotonic_ns() - begin;
        if (last != NULL && answer[0] == answer[0]) { /* NaN is no answer */
            memcpy(last, answer, (size_t)d * sizeof(double));
        }
    }
    return finish_integer(a, status);
}

#endif
