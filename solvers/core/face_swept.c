/* The solver that takes rows as Python calls it; see swept.h. */
#include "clock.h"
#include "face_solvers.h"
#include "swept.h"

TAKE_STATE(swept, Swept, SWEPT_KIND)

FACE(swept_bytes)
{
    const int d = (int)take_integer(a, 0, 10000);
    return finish_integer(a, good(a) ? swept_bytes(d) : 0);
}

/* Where the parts that Python looks at begin, in numbers from the start of the state, and in 32-bit numbers what the
 * head counts. */
FACE(swept_places)
{
    Swept s = take_swept(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    const real *const first = (const real *)(const void *)s.head;
    return finish(a, Py_BuildValue("{s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n}", "answer", s.answer - first,
                                   "origin", s.origin - first, "sign", s.sign - first, "free", s.free - first, "centre",
                                   s.centre - first, "rho", s.rho - first, "M", s.M - first, "G", s.G - first,
                                   "row_weight", (const real *)&s.head->row_weight - first, "cap",
                                   &s.head->cap - (int32_t *)s.head, "counts",
                                   (int32_t *)&s.head->exchanges - (int32_t *)s.head, "since_refresh",
                                   &s.head->since_refresh - (int32_t *)s.head));
}

FACE(swept_setup)
{
    void *const memory = take_state(a, 0);
    const double *const lb = take_array(a, VECTOR, ANY_LENGTH);
    const int d = (int)taken_length(a);
    const double *const ub = take_array(a, VECTOR, d);
    const double forgetting = take_number(a);
    const double row_weight = take_number(a);
    const double proximal = take_number(a);
    need_bytes(a, 0, swept_bytes(d));
    return finish_integer(a, good(a) ? swept_setup(memory, d, lb, ub, forgetting, row_weight, proximal) : 0);
}

static int begin(Swept *s, const double *P, const double *q)
{
    const int status = swept_begin(s, P, q, 0, 0);
    if (status == OK) {
        swept_answer(s);
    }
    return status;
}

FACE(swept_begin)
{
    Swept s = take_swept(a);
    const double *const P = take_array(a, s.d, s.d);
    const double *const q = take_array(a, VECTOR, s.d);
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, 1);
    return finish_integer(a, begin(&s, P, q));
}

FACE(swept_take)
{
    Swept s = take_swept(a);
    const double *const row = take_array(a, VECTOR, s.d + 1);
    int status = OK;
    if (good(a)) {
        status = swept_take(&s, row);
        swept_answer(&s);
    }
    return finish_integer(a, status);
}

FACE(swept_take_rows)
{
    Swept s = take_swept(a);
    const double *const rows = take_array(a, ANY_LENGTH, s.d + 1);
    const Py_ssize_t length = taken_length(a);
    double *const answers = take_output(a, length, s.d);
    int64_t *const nanoseconds = take_integers(a, length);
    int status = OK;
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, length > 1);
    for (Py_ssize_t k = 0; k < length && (status == OK || status == CAPPED); ++k) {
        const int64_t start = monotonic_ns();
        status = swept_take(&s, rows + k * (s.d + 1));
        if (status == SINGULAR || status == CYCLING) {
            status = swept_recover(&s);
        }
        swept_answer(&s);
        memcpy(answers + k * s.d, s.answer, (size_t)s.d * sizeof(double));
        nanoseconds[k] = monotonic_ns() - start;
    }
    return finish_integer(a, status);
}

static PyObject *do_to(int (*action)(Swept *s), Arguments *a)
{
    Swept s = take_swept(a);
    int status = OK;
    if (good(a)) {
        status = action(&s);
        swept_answer(&s);
    }
    return finish_integer(a, status);
}

FACE(swept_recover) { return do_to(swept_recover, a); }
FACE(swept_refresh) { return do_to(swept_refresh, a); }

FACE(swept_error)
{
    Swept s = take_swept(a);
    return finish_number(a, good(a) ? swept_error(&s) : 0);
}

/* It starts anew from P and q, which includes finding the optimum, so that all of it is the solve. */
typedef struct {
    Swept s;
    const double *P, *q;
} TimedSwept;

static int update(void *solver, const double *P, const double *q)
{
    TimedSwept *const t = solver;
    t->P = P;
    t->q = q;
    return OK;
}

static int solve(void *solver, const double *start, double *x)
{
    TimedSwept *const t = solver;
    const int status = begin(&t->s, t->P, t->q);
    (void)start;
    if (status == OK || status == CAPPED) {
        memcpy(x, t->s.answer, (size_t)t->s.d * sizeof(double));
    }
    return status;
}

FACE(time_swept)
{
    TimedSwept t = {take_swept(a), NULL, NULL};
    const TimedSolver solver = {&t, t.s.d, update, solve};
    return finish_timed(a, &solver);
}
