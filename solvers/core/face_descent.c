/* Gradient methods as Python calls them; see descent.h. */
#include "clock.h"
#include "descent.h"
#include "face_solvers.h"
#include "forgetting.h"

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

/* A cone, or NULL for None; it couples variables of the descent only. */
static Cone *take_cone(Arguments *a, Cone *cone, const Descent *s)
{
    void *const memory = take_optional_state(a, CONE_KIND);
    if (memory == NULL) {
        return NULL;
    }
    *cone = cone_at(memory);
    for (int k = 0; k < cone->coupled; ++k) {
        if (cone->index[k] < 0 || cone->index[k] >= s->d) {
            refuse(a, "the cone couples variables that there are not");
        }
    }
    return cone;
}

FACE(face_descent_start)
{
    Arguments a;
    Descent s;
    Cone room, *cone;
    const double *x;
    (void)module;
    take_arguments(&a, "descent_start(state, cone, x)", given, count, 3);
    take_descent(&a, &s);
    cone = take_cone(&a, &room, &s);
    x = take_optional(&a, VECTOR, s.d);
    return finish_integer(&a, good(&a) ? descent_start(&s, cone, x) : 0);
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

/* Both methods: steps of one run, or of runs from the same start again and again, each timed. The accelerated one knows no cone. */
typedef int64_t (*Method)(Descent *s, Cone *cone, int64_t steps, real tolerance);

static int64_t accelerated(Descent *s, Cone *cone, int64_t steps, real tolerance)
{
    (void)cone;
    return accelerated_steps(s, steps, tolerance);
}

static PyObject *steps_of(Method method, const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Descent s;
    Cone room, *cone;
    int64_t steps, taken = 0;
    double tolerance;
    take_arguments(&a, signature, given, count, 4);
    take_descent(&a, &s);
    cone = take_cone(&a, &room, &s);
    steps = take_integer(&a, 0, INT64_MAX);
    tolerance = take_number(&a);
    if (good(&a)) {
        begin_long_if(&a, steps > 100);
        taken = method(&s, cone, steps, tolerance);
    }
    return finish_integer(&a, taken);
}

static PyObject *time_of(Method method, const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Descent s;
    Cone room, *cone;
    int64_t steps, *nanoseconds;
    Py_ssize_t runs = 0;
    const double *x;
    double tolerance;
    take_arguments(&a, signature, given, count, 6);
    take_descent(&a, &s);
    cone = take_cone(&a, &room, &s);
    x = take_optional(&a, VECTOR, s.d);
    steps = take_integer(&a, 0, INT64_MAX);
    tolerance = take_number(&a);
    nanoseconds = take_integers(&a, &runs);
    if (good(&a)) {
        begin_long_if(&a, 1);
        for (Py_ssize_t k = 0; k < runs; ++k) {
            int64_t begin;
            descent_start(&s, cone, x);
            begin = monotonic_ns();
            method(&s, cone, steps, tolerance);
            nanoseconds[k] = monotonic_ns() - begin;
        }
    }
    return finish_integer(&a, 0);
}

FACE(face_projected_steps)
{
    (void)module;
    return steps_of(projected_steps, "projected_steps(state, cone, steps, threshold)", given, count);
}

FACE(face_accelerated_steps)
{
    (void)module;
    return steps_of(accelerated, "accelerated_steps(state, None, steps, tolerance)", given, count);
}

FACE(face_time_projected)
{
    (void)module;
    return time_of(projected_steps, "time_projected(state, cone, x, steps, threshold, nanoseconds)", given, count);
}

FACE(face_time_accelerated)
{
    (void)module;
    return time_of(accelerated, "time_accelerated(state, None, x, steps, tolerance, nanoseconds)", given, count);
}

/* Rows (xi, x) into P and q, and `steps` steps after each from where the last ones ended; timed is all but the row. */
FACE(face_projected_follow)
{
    Arguments a;
    Descent s;
    Cone room, *cone;
    double *P, *q, *answers, forgetting, ratio, c = 0;
    const double *rows;
    Py_ssize_t length;
    int64_t steps, *nanoseconds;
    int status = OK;
    (void)module;
    take_arguments(&a, "projected_follow(state, cone, P, q, rows, forgetting, ratio, steps, answers, nanoseconds)", given, count, 10);
    take_descent(&a, &s);
    cone = take_cone(&a, &room, &s);
    P = take_output(&a, s.d, s.d);
    q = take_output(&a, VECTOR, s.d);
    rows = take_array(&a, ANY_LENGTH, s.d + 1);
    length = taken_length(&a);
    forgetting = take_number(&a);
    ratio = take_number(&a);
    steps = take_integer(&a, 0, INT64_MAX);
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
        status = descent_take(&s, P, q, ratio, 0);
        projected_steps(&s, cone, steps, -1);
        nanoseconds[k] = monotonic_ns() - begin;
        memcpy(answers + k * s.d, s.w, (size_t)s.d * sizeof(double));
    }
    return finish_integer(&a, status);
}

FACE(face_cone_bytes)
{
    Arguments a;
    int rows, coupled;
    (void)module;
    take_arguments(&a, "cone_bytes(rows, coupled)", given, count, 2);
    rows = (int)take_integer(&a, 0, 10000);
    coupled = (int)take_integer(&a, 0, 10000);
    return finish_integer(&a, good(&a) ? cone_bytes(rows, coupled) : 0);
}

FACE(face_cone_setup)
{
    Arguments a;
    const double *A, *b;
    int64_t *index;
    void *memory;
    Py_ssize_t rows, coupled = 0;
    (void)module;
    take_arguments(&a, "cone_setup(state, A, b, index)", given, count, 4);
    memory = take_state(&a, 0);
    A = take_array(&a, ANY_LENGTH, ANY_LENGTH);
    rows = taken_length(&a);
    b = take_array(&a, VECTOR, (int)rows);
    index = take_integers(&a, &coupled);
    if (good(&a) && a.views[1].shape[1] != coupled) {
        refuse(&a, "A has a column for each coupled variable");
    }
    need_bytes(&a, 0, cone_bytes((int)rows, (int)coupled));
    return finish_integer(&a, good(&a) ? cone_setup(memory, (int)rows, (int)coupled, A, b, index) : 0);
}

/* Project x (d,) in place; a status. */
FACE(face_cone_project)
{
    Arguments a;
    Descent all;
    Cone room, *cone;
    double *x;
    (void)module;
    take_arguments(&a, "cone_project(x, cone)", given, count, 2);
    x = take_output(&a, VECTOR, ANY_LENGTH);
    all.d = (int)taken_length(&a);
    cone = take_cone(&a, &room, &all);
    return finish_integer(&a, good(&a) && cone != NULL ? cone_project(cone, x) : 0);
}

/* The multipliers of the rows at the last projection. */
FACE(face_cone_multipliers)
{
    Arguments a;
    void *memory;
    double *multipliers;
    Cone cone;
    (void)module;
    take_arguments(&a, "cone_multipliers(cone, multipliers)", given, count, 2);
    memory = take_state(&a, CONE_KIND);
    multipliers = take_output(&a, VECTOR, memory != NULL ? ((const ConeHead *)memory)->rows : 0);
    if (good(&a)) {
        cone = cone_at(memory);
        memcpy(multipliers, cone.dual.answer, (size_t)cone.rows * sizeof(double));
    }
    return finish_integer(&a, 0);
}
