/* The exact solver as Python calls it; see box.h. */
#include "box.h"
#include "clock.h"
#include "face_solvers.h"
#include "forgetting.h"

enum { LONG_FROM = 60 }; /* variables from which a solve takes longer than giving the interpreter away and back */

static void take_box(Arguments *a, Box *s)
{
    void *const memory = take_state(a, BOX_KIND);
    s->d = 0;
    if (memory != NULL) {
        *s = box_at(memory);
    }
}

FACE(face_box_bytes)
{
    Arguments a;
    int d;
    (void)module;
    take_arguments(&a, "box_bytes(d)", given, count, 1);
    d = (int)take_integer(&a, 0, 10000);
    return finish_integer(&a, good(&a) ? box_bytes(d) : 0);
}

/* Where the vectors that Python looks at begin, in numbers from the start of the state, and in 32-bit numbers what the head counts. */
FACE(face_box_places)
{
    Arguments a;
    Box s;
    const real *first;
    (void)module;
    take_arguments(&a, "box_places(state)", given, count, 1);
    take_box(&a, &s);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    first = (const real *)(const void *)s.head;
    return finish(&a, Py_BuildValue("{s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n}", "answer", s.answer - first, "raw_q", s.raw_q - first,
                                    "scale", s.scale - first, "P", s.P - first, "x", s.x - first, "g", s.g - first, "inverted",
                                    &s.head->inverted - (int32_t *)s.head, "singular", &s.head->singular - (int32_t *)s.head, "cap", &s.head->cap - (int32_t *)s.head, "counts",
                                    &s.head->exchanges - (int32_t *)s.head));
}

FACE(face_box_setup)
{
    Arguments a;
    const double *lb, *ub;
    void *memory;
    int d;
    (void)module;
    take_arguments(&a, "box_setup(state, lb, ub)", given, count, 3);
    memory = take_state(&a, 0);
    lb = take_array(&a, VECTOR, ANY_LENGTH);
    d = (int)taken_length(&a);
    ub = take_array(&a, VECTOR, d);
    need_bytes(&a, 0, box_bytes(d));
    return finish_integer(&a, good(&a) ? box_setup(memory, d, lb, ub) : 0);
}

static int take_data(Box *s, const double *P, const double *q)
{
    const int status = P != NULL ? box_take_hessian(s, P) : OK;
    return status == OK && q != NULL ? box_take_linear(s, q) : status;
}

FACE(face_box_take)
{
    Arguments a;
    Box s;
    const double *P, *q;
    (void)module;
    take_arguments(&a, "box_take(state, P, q)", given, count, 3);
    take_box(&a, &s);
    P = take_optional(&a, s.d, s.d);
    q = take_optional(&a, VECTOR, s.d);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, s.d >= LONG_FROM);
    return finish_integer(&a, take_data(&s, P, q));
}

FACE(face_box_start)
{
    Arguments a;
    Box s;
    const double *x;
    (void)module;
    take_arguments(&a, "box_start(state, x)", given, count, 2);
    take_box(&a, &s);
    x = take_array(&a, VECTOR, s.d);
    return finish_integer(&a, good(&a) ? box_start(&s, x) : 0);
}

static PyObject *solve_by(int (*method)(Box *s, int warm), const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Box s;
    int warm;
    take_arguments(&a, signature, given, count, 2);
    take_box(&a, &s);
    warm = (int)take_integer(&a, 0, 1);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, s.d >= LONG_FROM);
    return finish_integer(&a, method(&s, warm));
}

FACE(face_box_solve)
{
    (void)module;
    return solve_by(box_solve, "box_solve(state, warm)", given, count);
}

FACE(face_box_solve_factorised)
{
    (void)module;
    return solve_by(box_solve_factorised, "box_solve_factorised(state, warm)", given, count);
}

/* After a solve by the factorisation: put the variables to the given sides, and let the dual method find the way back. */
FACE(face_box_dual_from)
{
    Arguments a;
    Box s;
    Py_ssize_t length = 0;
    const int64_t *sides;
    int status = BREAKDOWN;
    (void)module;
    take_arguments(&a, "box_dual_from(state, sides)", given, count, 2);
    take_box(&a, &s);
    sides = take_integers(&a, &length);
    if (length != s.d) {
        refuse(&a, "there is a side for each variable");
    }
    if (good(&a)) {
        for (int j = 0; j < s.d; ++j) {
            if (s.side[j] != FIXED) {
                box_move(&s, j, (int)sides[j]);
            }
        }
        box_list_free(&s);
        status = box_newton(&s) ? box_dual_active_set(&s) : BREAKDOWN;
    }
    return finish_integer(&a, status);
}

FACE(face_time_box)
{
    Arguments a;
    Box s;
    const double *P, *q, *x;
    Py_ssize_t runs = 0, solves = 0;
    int64_t *update_ns, *solve_ns;
    int warm, status = OK;
    (void)module;
    take_arguments(&a, "time_box(state, P, q, warm, x, updates, solves)", given, count, 7);
    take_box(&a, &s);
    P = take_array(&a, s.d, s.d);
    q = take_array(&a, VECTOR, s.d);
    warm = (int)take_integer(&a, 0, 1);
    x = take_optional(&a, VECTOR, s.d);
    update_ns = take_integers(&a, &runs);
    solve_ns = take_integers(&a, &solves);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, 1);
    for (Py_ssize_t k = 0; k < runs && k < solves; ++k) {
        const int64_t begin = monotonic_ns();
        int64_t between;
        status = take_data(&s, P, q);
        between = monotonic_ns();
        if (x != NULL && status == OK) {
            status = box_start(&s, x);
        }
        status = status == OK ? box_solve(&s, warm || x != NULL) : status;
        solve_ns[k] = monotonic_ns() - between;
        update_ns[k] = between - begin;
    }
    return finish_integer(&a, status);
}

/* Rows (xi, x) into P and q, and a solve after each, warm from the last active set; timed without the first. */
FACE(face_box_follow)
{
    Arguments a;
    Box s;
    double *P, *q, *answers, forgetting, c = 0;
    const double *rows;
    Py_ssize_t length = 0;
    int64_t *nanoseconds;
    int status = OK;
    (void)module;
    take_arguments(&a, "box_follow(state, P, q, rows, forgetting, answers, nanoseconds)", given, count, 7);
    take_box(&a, &s);
    P = take_output(&a, s.d, s.d);
    q = take_output(&a, VECTOR, s.d);
    rows = take_array(&a, ANY_LENGTH, s.d + 1);
    length = taken_length(&a);
    forgetting = take_number(&a);
    answers = take_output(&a, (int)length, s.d);
    nanoseconds = take_integers(&a, &length);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, 1);
    for (Py_ssize_t k = 0; k < length && status == OK; ++k) {
        int64_t begin;
        absorb(P, q, &c, s.d, rows + k * (s.d + 1), forgetting);
        begin = monotonic_ns();
        status = take_data(&s, P, q);
        status = status == OK ? box_solve(&s, 1) : status;
        nanoseconds[k] = monotonic_ns() - begin;
        memcpy(answers + k * s.d, s.answer, (size_t)s.d * sizeof(double));
    }
    return finish_integer(&a, status);
}

FACE(face_absorb)
{
    Arguments a;
    double *P, *q, *c, forgetting;
    const double *rows;
    Py_ssize_t length;
    int d;
    (void)module;
    take_arguments(&a, "absorb(P, q, c, rows, forgetting)", given, count, 5);
    P = take_output(&a, ANY_LENGTH, ANY_LENGTH);
    d = (int)taken_length(&a);
    if (good(&a) && a.views[0].shape[1] != d) {
        refuse(&a, "P is square");
    }
    q = take_output(&a, VECTOR, d);
    c = take_output(&a, VECTOR, 1);
    rows = take_array(&a, ANY_LENGTH, d + 1);
    length = taken_length(&a);
    forgetting = take_number(&a);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, length > 10);
    for (Py_ssize_t k = 0; k < length; ++k) {
        absorb(P, q, c, d, rows + k * (d + 1), forgetting);
    }
    return finish_integer(&a, 0);
}

/* DAQP's sense of each row l <= R x <= u at x, as in `cold` unless that is 0: 1 at the upper side, 3 at the lower one. The first rows of
 * R are those of the identity. */
FACE(face_touched)
{
    enum { AT_UPPER = 1, AT_LOWER = 3 };
    Arguments a;
    const double *R, *l, *u, *x;
    double tolerance;
    int *cold, *sense, d;
    Py_ssize_t rows, length = 0;
    (void)module;
    take_arguments(&a, "touched(R, l, u, x, tolerance, cold, sense)", given, count, 7);
    R = take_array(&a, ANY_LENGTH, ANY_LENGTH);
    rows = taken_length(&a);
    d = good(&a) ? (int)a.views[0].shape[1] : 0;
    l = take_array(&a, VECTOR, (int)rows);
    u = take_array(&a, VECTOR, (int)rows);
    x = take_array(&a, VECTOR, d);
    tolerance = take_number(&a);
    cold = take_ints(&a, &length);
    if (length != rows) {
        refuse(&a, "there is a sense for each row");
    }
    sense = take_ints(&a, &length);
    if (length != rows) {
        refuse(&a, "there is a sense for each row");
    }
    for (Py_ssize_t i = 0; good(&a) && i < rows; ++i) {
        double value = i < d ? x[i] : 0;
        for (int j = 0; i >= d && j < d; ++j) {
            value += R[i * d + j] * x[j];
        }
        sense[i] = cold[i] != 0 ? cold[i] : value <= l[i] + tolerance ? AT_LOWER : value >= u[i] - tolerance ? AT_UPPER : 0;
    }
    return finish_integer(&a, 0);
}

/* Steps that wait for the clock: what they take longer than they last is the machine's. */
FACE(face_time_nothing)
{
    Arguments a;
    int64_t lasting, *nanoseconds;
    Py_ssize_t steps = 0;
    (void)module;
    take_arguments(&a, "time_nothing(lasting, nanoseconds)", given, count, 2);
    lasting = take_integer(&a, 0, INT64_MAX);
    nanoseconds = take_integers(&a, &steps);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, 1);
    for (Py_ssize_t k = 0; k < steps; ++k) {
        const int64_t start = monotonic_ns();
        int64_t now = monotonic_ns();
        while (now - start < lasting) {
            now = monotonic_ns();
        }
        nanoseconds[k] = now - start;
    }
    return finish_integer(&a, 0);
}
