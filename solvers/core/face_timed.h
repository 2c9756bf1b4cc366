/* The arguments of the timed loop, which are the last ones of every function that times a solver. */
#ifndef CORE_FACE_TIMED_H
#define CORE_FACE_TIMED_H

#include "face.h"
#include "timed_calls.h"

#define TIMED "P, q, start, most_ns, updates, solves, answers"
enum { TIMED_COUNT = 7 };

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

#endif
