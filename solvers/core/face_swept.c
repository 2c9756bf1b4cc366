/* The solver that takes rows as Python calls it; see swept.h. */
#include "clock.h"
#include "face_solvers.h"
#include "swept.h"

static void take_swept(Arguments *a, Swept *s)
{
    void *const memory = take_state(a, SWEPT_KIND);
    s->d = 0;
    if (memory != NULL) {
        *s = swept_at(memory);
    }
}

FACE(face_swept_bytes)
{
    Arguments a;
    int d;
    (void)module;
    take_arguments(&a, "swept_bytes(d)", given, count, 1);
    d = (int)take_integer(&a, 0, 10000);
    return finish_integer(&a, good(&a) ? swept_bytes(d) : 0);
}

/* Where the parts that Python looks at begin, in numbers from the start of the state, and in 32-bit numbers what the head counts. */
FACE(face_swept_places)
{
    Arguments a;
    Swept s;
    const real *first;
    (void)module;
    take_arguments(&a, "swept_places(state)", given, count, 1);
    take_swept(&a, &s);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    first = (const real *)(const void *)s.head;
    return finish(&a, Py_BuildValue("{s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n,s:n}", "answer", s.answer - first, "origin",
                                    s.origin - first, "sign", s.sign - first, "free", s.free - first, "centre", s.centre - first,
                                    "rho", s.rho - first, "M", s.M - first, "G", s.G - first, "row_weight",
                                    (const real *)&s.head->row_weight - first, "cap", &s.head->cap - (int32_t *)s.head, "counts",
                                    &s.head->exchanges - (int32_t *)s.head, "since_refresh",
                                    &s.head->since_refresh - (int32_t *)s.head));
}

FACE(face_swept_setup)
{
    Arguments a;
    const double *lb, *ub;
    double forgetting, row_weight, proximal;
    void *memory;
    int d;
    (void)module;
    take_arguments(&a, "swept_setup(state, lb, ub, forgetting, row_weight, proximal)", given, count, 6);
    memory = take_state(&a, 0);
    lb = take_array(&a, VECTOR, ANY_LENGTH);
    d = (int)taken_length(&a);
    ub = take_array(&a, VECTOR, d);
    forgetting = take_number(&a);
    row_weight = take_number(&a);
    proximal = take_number(&a);
    need_bytes(&a, 0, swept_bytes(d));
    return finish_integer(&a, good(&a) ? swept_setup(memory, d, lb, ub, forgetting, row_weight, proximal) : 0);
}

static int begin(Swept *s, const double *P, const double *q)
{
    const int status = swept_begin(s, P, q, 0, 0);
    if (status == OK) {
        swept_answer(s);
    }
    return status;
}

FACE(face_swept_begin)
{
    Arguments a;
    Swept s;
    const double *P, *q;
    (void)module;
    take_arguments(&a, "swept_begin(state, P, q)", given, count, 3);
    take_swept(&a, &s);
    P = take_array(&a, s.d, s.d);
    q = take_array(&a, VECTOR, s.d);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, 1);
    return finish_integer(&a, begin(&s, P, q));
}

FACE(face_swept_take)
{
    Arguments a;
    Swept s;
    const double *row;
    int status = OK;
    (void)module;
    take_arguments(&a, "swept_take(state, row)", given, count, 2);
    take_swept(&a, &s);
    row = take_array(&a, VECTOR, s.d + 1);
    if (good(&a)) {
        status = swept_take(&s, row);
        swept_answer(&s);
    }
    return finish_integer(&a, status);
}

FACE(face_swept_take_rows)
{
    Arguments a;
    Swept s;
    const double *rows;
    double *answers;
    int64_t *nanoseconds;
    Py_ssize_t length;
    int status = OK;
    (void)module;
    take_arguments(&a, "swept_take_rows(state, rows, answers, nanoseconds)", given, count, 4);
    take_swept(&a, &s);
    rows = take_array(&a, ANY_LENGTH, s.d + 1);
    length = taken_length(&a);
    answers = take_output(&a, (int)length, s.d);
    nanoseconds = take_integers(&a, &length);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, length > 1);
    for (Py_ssize_t k = 0; k < length && (status == OK || status == CAPPED); ++k) {
        const int64_t start = monotonic_ns();
        status = swept_take(&s, rows + k * (s.d + 1));
        if (status == SINGULAR || status == CYCLING) {
            status = swept_recover(&s);
        }
        swept_answer(&s);
        nanoseconds[k] = monotonic_ns() - start;
        memcpy(answers + k * s.d, s.answer, (size_t)s.d * sizeof(double));
    }
    return finish_integer(&a, status);
}

static PyObject *do_to(int (*action)(Swept *s), const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Swept s;
    int status = OK;
    take_arguments(&a, signature, given, count, 1);
    take_swept(&a, &s);
    if (good(&a)) {
        status = action(&s);
        swept_answer(&s);
    }
    return finish_integer(&a, status);
}

FACE(face_swept_recover)
{
    (void)module;
    return do_to(swept_recover, "swept_recover(state)", given, count);
}

FACE(face_swept_refresh)
{
    (void)module;
    return do_to(swept_refresh, "swept_refresh(state)", given, count);
}

FACE(face_swept_error)
{
    Arguments a;
    Swept s;
    (void)module;
    take_arguments(&a, "swept_error(state)", given, count, 1);
    take_swept(&a, &s);
    return finish_number(&a, good(&a) ? swept_error(&s) : 0);
}

FACE(face_time_swept)
{
    Arguments a;
    Swept s;
    const double *P, *q;
    int64_t *nanoseconds;
    Py_ssize_t runs = 0;
    int status = OK;
    (void)module;
    take_arguments(&a, "time_swept(state, P, q, nanoseconds)", given, count, 4);
    take_swept(&a, &s);
    P = take_array(&a, s.d, s.d);
    q = take_array(&a, VECTOR, s.d);
    nanoseconds = take_integers(&a, &runs);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    begin_long_if(&a, 1);
    for (Py_ssize_t k = 0; k < runs; ++k) {
        const int64_t start = monotonic_ns();
        status = begin(&s, P, q);
        nanoseconds[k] = monotonic_ns() - start;
    }
    return finish_integer(&a, status);
}
