/* Gradient methods as Python calls them; see descent.h. */
#include "clock.h"
#include "descent.h"
#include "face_solvers.h"

static void take_descent(Arguments *a, Descent *s)
{
    void *const memory = take_state(a, DESCENT_KIND);
    if (memory != NULL) {
        *s = descent_at(memory);
    } else {
        s->d = 0;
    }
}

FACE(face_descent_bytes)
{
    Arguments a;
    int d;
    (void)module;
    take_arguments(&a, "descent_bytes(d)", given, count, 1);
    d = (int)take_integer(&a, 0, 10000);
    return finish_integer(&a, good(&a) ? descent_bytes(d) : 0);
}

/* Where the vectors that Python looks at begin, in numbers from the start of the state. */
FACE(face_descent_places)
{
    Arguments a;
    Descent s;
    const real *first;
    (void)module;
    take_arguments(&a, "descent_places(state)", given, count, 1);
    take_descent(&a, &s);
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    first = (const real *)(const void *)s.head;
    return finish(&a, Py_BuildValue("{s:n,s:n,s:n,s:n,s:n}", "w", s.w - first, "lower", s.lower - first, "upper", s.upper - first,
                                    "D", s.D - first, "answer", s.answer - first));
}

FACE(face_descent_setup)
{
    Arguments a;
    const double *lb, *ub;
    void *memory;
    int d;
    (void)module;
    take_arguments(&a, "descent_setup(state, lb, ub)", given, count, 3);
    memory = take_state(&a, 0);
    lb = take_array(&a, VECTOR, ANY_LENGTH);
    d = (int)taken_length(&a);
    ub = take_array(&a, VECTOR, d);
    need_bytes(&a, 0, descent_bytes(d));
    return finish_integer(&a, good(&a) ? descent_setup(memory, d, lb, ub) : 0);
}

FACE(face_descent_take)
{
    Arguments a;
    Descent s;
    const double *P, *q;
    double ratio;
    int scaled;
    (void)module;
    take_arguments(&a, "descent_take(state, P, q, ratio, scaled)", given, count, 5);
    take_descent(&a, &s);
    P = take_optional(&a, s.d, s.d);
    q = take_optional(&a, VECTOR, s.d);
    ratio = take_number(&a);
    scaled = (int)take_integer(&a, 0, 1);
    return finish_integer(&a, good(&a) ? descent_take(&s, P, q, ratio, scaled) : 0);
}

FACE(face_descent_start)
{
    Arguments a;
    Descent s;
    const double *x;
    (void)module;
    take_arguments(&a, "descent_start(state, x)", given, count, 2);
    take_descent(&a, &s);
    x = take_optional(&a, VECTOR, s.d);
    if (good(&a)) {
        descent_start(&s, x);
    }
    return finish_integer(&a, 0);
}

FACE(face_descent_answer)
{
    Arguments a;
    Descent s;
    (void)module;
    take_arguments(&a, "descent_answer(state)", given, count, 1);
    take_descent(&a, &s);
    if (good(&a)) {
        descent_answer(&s);
    }
    return finish_integer(&a, 0);
}

/* Both methods: steps of one run, or of runs from the same start again and again, each timed. */
typedef int64_t (*Method)(Descent *s, int64_t steps, real tolerance);

static PyObject *steps_of(Method method, const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Descent s;
    int64_t steps, taken = 0;
    double tolerance;
    take_arguments(&a, signature, given, count, 3);
    take_descent(&a, &s);
    steps = take_integer(&a, 0, INT64_MAX);
    tolerance = take_number(&a);
    if (good(&a)) {
        begin_long_if(&a, steps > 100);
        taken = method(&s, steps, tolerance);
    }
    return finish_integer(&a, taken);
}

static PyObject *time_of(Method method, const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Descent s;
    int64_t steps, *nanoseconds;
    Py_ssize_t runs = 0;
    const double *x;
    double tolerance;
    take_arguments(&a, signature, given, count, 5);
    take_descent(&a, &s);
    x = take_optional(&a, VECTOR, s.d);
    steps = take_integer(&a, 0, INT64_MAX);
    tolerance = take_number(&a);
    nanoseconds = take_integers(&a, &runs);
    if (good(&a)) {
        begin_long_if(&a, 1);
        for (Py_ssize_t k = 0; k < runs; ++k) {
            int64_t begin;
            descent_start(&s, x);
            begin = monotonic_ns();
            method(&s, steps, tolerance);
            nanoseconds[k] = monotonic_ns() - begin;
        }
    }
    return finish_integer(&a, 0);
}

FACE(face_projected_steps)
{
    (void)module;
    return steps_of(projected_steps, "projected_steps(state, steps, threshold)", given, count);
}

FACE(face_accelerated_steps)
{
    (void)module;
    return steps_of(accelerated_steps, "accelerated_steps(state, steps, tolerance)", given, count);
}

FACE(face_time_projected)
{
    (void)module;
    return time_of(projected_steps, "time_projected(state, x, steps, threshold, nanoseconds)", given, count);
}

FACE(face_time_accelerated)
{
    (void)module;
    return time_of(accelerated_steps, "time_accelerated(state, x, steps, tolerance, nanoseconds)", given, count);
}
