/* Gradient methods as Python calls them; see descent.h. */
#include "clock.h"
#include "descent.h"
#include "bindings_timed.h"

#define DESCENT ((ProjectedGradient[]){descent_at(MEMORY(0))})
#define TIMED_DESCENT(...) (&(TimedSolver){(TimedProjectedGradient[]){{DESCENT, __VA_ARGS__}}, SIZE(d), update, solve})

typedef struct {
    const ProjectedGradient *s;
    int64_t (*method)(const ProjectedGradient *s, int64_t steps, real tolerance);
    double ratio;
    int scaled;
    int64_t steps;
    double tolerance;
} TimedProjectedGradient;

static int update(void *solver, const double *P, const double *q)
{
    const TimedProjectedGradient *const t = solver;
    return descent_set_data(t->s, P, q, t->ratio, t->scaled);
}

static int solve(void *solver, const double *start, double *x)
{
    const TimedProjectedGradient *const t = solver;
    descent_start(t->s, start);
    t->method(t->s, t->steps, t->tolerance);
    descent_answer(t->s);
    memcpy(x, t->s->answer, (size_t)t->s->d * sizeof(double));
    return t->s->head->met ? OK : CAPPED;
}

/* Offsets of the fields that Python reads. */
static void field_offsets(Arguments *a, const ProjectedGradient *s)
{
    const Field fields[] = {{"answer", s->answer, s->d},
                            {"eta", &s->head->eta, 1},
                            {"steps", &s->head->steps, 1},
                            {"met", &s->head->met, 1}};
    RETURN_FIELDS(s->head, fields);
}

#define TIMED_METHOD "state@DSC1, ratio, scaled#0:1, steps#0:, tolerance, " TIMED
#define BINDINGS(F)                                                                                                    \
    F(descent_bytes, "d#0:10000", "size of the state of a gradient method.", 0, WHOLE_RESULT = descent_bytes(INT(0)))  \
    F(descent_field_offsets, "state@DSC1", "offsets of its parts.", 0, field_offsets(&a, DESCENT))                     \
    F(descent_setup, "state@, lb[d], ub[d]", "make a block a state; a status.", NEED_BYTES(0, descent_bytes(SIZE(d))), \
      WHOLE_RESULT = descent_setup(MEMORY(0), SIZE(d), REALS(1), REALS(2)))                                            \
    F(descent_set_data, "state@DSC1, P[d,d]?, q[d]?, ratio, scaled#0:1",                                               \
      "new data, None for data that stay; a status.", 0,                                                               \
      WHOLE_RESULT = descent_set_data(DESCENT, REALS(1), REALS(2), NUMBER(3), INT(4)))                                 \
    F(all_finite, "x[n]", "whether each number is finite.", 0, WHOLE_RESULT = are_finite(REALS(0), LENGTH(n)))         \
    F(descent_start, "state@DSC1, x[d]?", "begin at x, at 0 for None.", 0, descent_start(DESCENT, REALS(1)))           \
    F(descent_answer, "state@DSC1", "write the answer.", 0, descent_answer(DESCENT))                                   \
    F(projected_steps, "state@DSC1, steps#0:, tolerance", "take steps; their number.", WHOLE(1) > 100,                 \
      WHOLE_RESULT = projected_steps(DESCENT, WHOLE(1), NUMBER(2)))                                                    \
    F(accelerated_steps, "state@DSC1, steps#0:, tolerance", "take steps; their number.", WHOLE(1) > 100,               \
      WHOLE_RESULT = accelerated_steps(DESCENT, WHOLE(1), NUMBER(2)))                                                  \
    F(time_projected, TIMED_METHOD, "as time_box.", 1,                                                                 \
      WHOLE_RESULT = TIMED_BY(5, TIMED_DESCENT(projected_steps, NUMBER(1), INT(2), WHOLE(3), NUMBER(4))))              \
    F(time_accelerated, TIMED_METHOD, "as time_box.", 1,                                                               \
      WHOLE_RESULT = TIMED_BY(5, TIMED_DESCENT(accelerated_steps, NUMBER(1), INT(2), WHOLE(3), NUMBER(4))))
MAKE_BINDINGS(descent)
