/* Gradient methods as Python calls them; see descent.h. */
#include "clock.h"
#include "descent.h"
#include "face_solvers.h"

TAKE_STATE(descent, Descent, DESCENT_KIND)

FACE(descent_bytes)
{
    const int d = (int)take_integer(a, 0, 10000);
    return finish_integer(a, good(a) ? descent_bytes(d) : 0);
}

/* Where the vectors that Python looks at begin, in numbers from the start of the state. */
FACE(descent_places)
{
    Descent s = take_descent(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    const real *const first = (const real *)(const void *)s.head;
    return finish(a, Py_BuildValue("{s:n,s:n,s:n}", "w", s.w - first, "D", s.D - first, "answer", s.answer - first));
}

FACE(descent_setup)
{
    void *const memory = take_state(a, 0);
    const double *const lb = take_array(a, VECTOR, ANY_LENGTH);
    const int d = (int)taken_length(a);
    const double *const ub = take_array(a, VECTOR, d);
    need_bytes(a, 0, descent_bytes(d));
    return finish_integer(a, good(a) ? descent_setup(memory, d, lb, ub) : 0);
}

FACE(descent_take)
{
    Descent s = take_descent(a);
    const double *const P = take_optional(a, s.d, s.d);
    const double *const q = take_optional(a, VECTOR, s.d);
    const double ratio = take_number(a);
    const int scaled = (int)take_integer(a, 0, 1);
    return finish_integer(a, good(a) ? descent_take(&s, P, q, ratio, scaled) : 0);
}

FACE(descent_start)
{
    Descent s = take_descent(a);
    const double *const x = take_optional(a, VECTOR, s.d);
    if (good(a)) {
        descent_start(&s, x);
    }
    return finish_integer(a, 0);
}

FACE(descent_answer)
{
    Descent s = take_descent(a);
    if (good(a)) {
        descent_answer(&s);
    }
    return finish_integer(a, 0);
}

/* Both methods: steps of one run, or timed runs, each with new data. */
typedef int64_t (*Method)(Descent *s, int64_t steps, real tolerance);

static PyObject *steps_of(Method method, Arguments *a)
{
    Descent s = take_descent(a);
    const int64_t steps = take_integer(a, 0, INT64_MAX);
    const double tolerance = take_number(a);
    int64_t taken = 0;
    if (good(a)) {
        begin_long_if(a, steps > 100);
        taken = method(&s, steps, tolerance);
    }
    return finish_integer(a, taken);
}

typedef struct {
    Descent s;
    double ratio;
    int scaled;
    int64_t steps;
    double tolerance;
    Method method;
} TimedDescent;

static int update(void *solver, const double *P, const double *q)
{
    TimedDescent *const t = solver;
    return descent_take(&t->s, P, q, t->ratio, t->scaled);
}

static int solve(void *solver, const double *start, double *x)
{
    TimedDescent *const t = solver;
    descent_start(&t->s, start);
    t->method(&t->s, t->steps, t->tolerance);
    descent_answer(&t->s);
    memcpy(x, t->s.answer, (size_t)t->s.d * sizeof(double));
    return OK;
}

static PyObject *time_of(Method method, Arguments *a)
{
    TimedDescent t;
    t.s = take_descent(a);
    t.ratio = take_number(a);
    t.scaled = (int)take_integer(a, 0, 1);
    t.steps = take_integer(a, 0, INT64_MAX);
    t.tolerance = take_number(a);
    t.method = method;
    const TimedSolver solver = {&t, t.s.d, update, solve};
    return finish_timed(a, &solver);
}

FACE(projected_steps) { return steps_of(projected_steps, a); }
FACE(accelerated_steps) { return steps_of(accelerated_steps, a); }
FACE(time_projected) { return time_of(projected_steps, a); }
FACE(time_accelerated) { return time_of(accelerated_steps, a); }

static int solve_on(void *solver, const double *start, double *x)
{
    TimedDescent *const t = solver;
    (void)start;
    t->method(&t->s, t->steps, t->tolerance);
    memcpy(x, t->s.w, (size_t)t->s.d * sizeof(double));
    return OK;
}

/* So many steps after each row from where the last ones ended. */
FACE(projected_follow)
{
    TimedDescent t;
    t.s = take_descent(a);
    t.ratio = take_number(a);
    t.scaled = 0;
    t.steps = take_integer(a, 0, INT64_MAX);
    t.tolerance = -1;
    t.method = projected_steps;
    const TimedSolver solver = {&t, t.s.d, update, solve_on};
    return finish_followed(a, &solver, NULL);
}
