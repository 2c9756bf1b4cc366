/* The exact solver as Python calls it; see box.h. */
#include "box_fallback.h"
#include "clock.h"
#include "face_solvers.h"
#include "forgetting.h"

enum { LONG_FROM = 60 }; /* variables from which a solve takes longer than giving the interpreter away and back */

TAKE_STATE(box, Box, BOX_KIND)

FACE(box_bytes)
{
    const int d = (int)take_integer(a, 0, 10000);
    return finish_integer(a, good(a) ? box_bytes(d) : 0);
}

/* Where the vectors that Python looks at begin, in numbers from the start of the state, and in 32-bit numbers what the
 * head counts. */
FACE(box_places)
{
    Box s = take_box(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    const real *const first = (const real *)(const void *)s.head;
    return finish(a, Py_BuildValue("{s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n}", "answer", s.answer - first, "raw_q",
                                   s.raw_q - first, "scale", s.scale - first, "P", s.P - first, "x", s.x - first, "g",
                                   s.g - first, "inverted", &s.head->inverted - (int32_t *)s.head, "singular",
                                   &s.head->singular - (int32_t *)s.head, "cap", &s.head->cap - (int32_t *)s.head,
                                   "counts", &s.head->exchanges - (int32_t *)s.head));
}

FACE(box_setup)
{
    void *const memory = take_state(a, 0);
    const double *const lb = take_array(a, VECTOR, ANY_LENGTH);
    const int d = (int)taken_length(a);
    const double *const ub = take_array(a, VECTOR, d);
    need_bytes(a, 0, box_bytes(d));
    return finish_integer(a, good(a) ? box_setup(memory, d, lb, ub) : 0);
}

static int take_data(Box *s, const double *P, const double *q)
{
    const int status = P != NULL ? box_take_hessian(s, P) : OK;
    return status == OK && q != NULL ? box_take_linear(s, q) : status;
}

FACE(box_take)
{
    Box s = take_box(a);
    const double *const P = take_optional(a, s.d, s.d);
    const double *const q = take_optional(a, VECTOR, s.d);
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, s.d >= LONG_FROM);
    return finish_integer(a, take_data(&s, P, q));
}

FACE(box_start)
{
    Box s = take_box(a);
    const double *const x = take_array(a, VECTOR, s.d);
    return finish_integer(a, good(a) ? box_start(&s, x) : 0);
}

static PyObject *solve_by(int (*method)(Box *s, int warm), Arguments *a)
{
    Box s = take_box(a);
    const int warm = (int)take_integer(a, 0, 1);
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, s.d >= LONG_FROM);
    return finish_integer(a, method(&s, warm));
}

FACE(box_solve) { return solve_by(box_solve, a); }
FACE(box_solve_factorised) { return solve_by(box_solve_factorised, a); }

/* After a solve by the factorisation: put the variables to the given sides, and let the dual method find the way back.
 */
FACE(box_dual_from)
{
    Box s = take_box(a);
    const int64_t *const sides = take_integers(a, s.d);
    int status = BREAKDOWN;
    if (good(a)) {
        const Fallback f = fallback_at(&s);
        for (int j = 0; j < s.d; ++j) {
            f.program.side[j] = s.lo[j] < s.hi[j] ? (double)sides[j] : LOWER;
        }
        status = box_dual_active_set(&f);
        memcpy(s.x, f.program.x, (size_t)s.d * sizeof(double));
        memcpy(s.g, f.program.g, (size_t)s.d * sizeof(double));
    }
    return finish_integer(a, status);
}

FACE(factor_bytes)
{
    const int d = (int)take_integer(a, 1, 1000);
    return finish_integer(a, good(a) ? factor_bytes(d) : 0);
}

FACE(factor_solve)
{
    void *const memory = take_state(a, 0);
    const double *const free = take_array(a, VECTOR, ANY_LENGTH);
    const int d = (int)taken_length(a);
    const double *const P = take_array(a, d, padded(d + 1));
    const double least = take_number(a);
    double *const x = take_output(a, VECTOR, d);
    int safe = 0, count = 0;
    need_bytes(a, 0, factor_bytes(d));
    if (good(a)) {
        Room room = {memory};
        const Factor f = factor_at(&room, d);
        for (int i = 0; i < d; ++i) {
            f.rows[count] = i;
            count += free[i] > 0;
        }
        safe = factorise(&f, P, free, count, least) > 0;
        substitute_back(&f, count, x);
    }
    return finish_integer(a, safe);
}

typedef struct {
    Box s;
    int warm;
} TimedBox;

static int update(void *solver, const double *P, const double *q) { return take_data(&((TimedBox *)solver)->s, P, q); }

static int solve(void *solver, const double *start, double *x)
{
    TimedBox *const t = solver;
    int status = start != NULL ? box_start(&t->s, start) : OK;
    if (status == OK) {
        status = box_solve(&t->s, t->warm || start != NULL);
    }
    if (status == OK || status == CAPPED) {
        memcpy(x, t->s.answer, (size_t)t->s.d * sizeof(double));
    }
    return status;
}

FACE(time_box)
{
    TimedBox t;
    t.s = take_box(a);
    t.warm = (int)take_integer(a, 0, 1);
    const TimedSolver solver = {&t, t.s.d, update, solve};
    return finish_timed(a, &solver);
}

/* Warm from the last active set. */
FACE(box_follow)
{
    TimedBox t;
    t.s = take_box(a);
    t.warm = 1;
    const TimedSolver solver = {&t, t.s.d, update, solve};
    return finish_followed(a, &solver, NULL);
}

FACE(absorb)
{
    double *const P = take_output(a, ANY_LENGTH, ANY_LENGTH);
    const int d = (int)taken_length(a);
    if (good(a) && a->views[0].shape[1] != d) {
        refuse(a, "P is square");
    }
    double *const q = take_output(a, VECTOR, d);
    double *const c = take_output(a, VECTOR, 1);
    const double *const rows = take_array(a, ANY_LENGTH, d + 1);
    const Py_ssize_t length = taken_length(a);
    const double forgetting = take_number(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, length > 10);
    for (Py_ssize_t k = 0; k < length; ++k) {
        absorb(P, q, c, d, rows + k * (d + 1), forgetting);
    }
    return finish_integer(a, 0);
}

/* Steps that wait for the clock: what they take longer than they last is the machine's. */
FACE(time_nothing)
{
    const int64_t lasting = take_integer(a, 0, INT64_MAX);
    int64_t *const nanoseconds = take_integers(a, ANY_LENGTH);
    const Py_ssize_t steps = taken_length(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, 1);
    for (Py_ssize_t k = 0; k < steps; ++k) {
        const int64_t start = monotonic_ns();
        int64_t now = monotonic_ns();
        while (now - start < lasting) {
            now = monotonic_ns();
        }
        nanoseconds[k] = now - start;
    }
    return finish_integer(a, 0);
}
