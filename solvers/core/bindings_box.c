/* The exact solver as Python calls it; see box.h. */
#include "box.h"
#include "clock.h"
#include "bindings_timed.h"

enum { LONG_FROM = 60 }; /* variables from which a solve takes longer than releasing the interpreter's lock */

#define BOX ((Box[]){box_at(MEMORY(0))})

/* The fields that Python reads; three counters begin at the exchanges. */
static void field_offsets(Arguments *a, const Box *s)
{
    const Field fields[] = {
        {"answer", s->answer, s->d}, {"raw_q", s->raw_q, s->d},         {"scale", s->scale, s->d},
        {"cost", &s->head->cost, 1}, {"P", s->P, s->d * s->ld},         {"x", s->z, s->d},
        {"g", s->grad_z, s->d},      {"side", s->side, (s->d + 1) / 2}, {"singular", &s->head->singular, 1},
        {"cap", &s->head->cap, 1},   {"counts", &s->head->exchanges, 3}};
    RETURN_FIELDS(s->head, fields);
}

static int update(void *solver, const double *P, const double *q) { return box_set_data(solver, P, q); }

static int solve_from(Box *s, const double *start, double *x, int warm)
{
    int status = start != NULL ? box_start(s, start) : OK;
    if (status == OK) {
        status = box_solve(s, warm || start != NULL);
    }
    if (status == OK || status == CAPPED) {
        memcpy(x, s->answer, (size_t)s->d * sizeof(double));
    }
    return status;
}
static int solve_cold(void *solver, const double *start, double *x) { return solve_from(solver, start, x, 0); }
static int solve_warm(void *solver, const double *start, double *x) { return solve_from(solver, start, x, 1); }

#define BINDINGS(F)                                                                                                    \
    F(box_bytes, "d#0:10000", "size of the state of the exact solver.", 0, WHOLE_RESULT = box_bytes(INT(0)))           \
    F(box_field_offsets, "state@BOX1", "offsets of its vectors and counters.", 0, field_offsets(&a, BOX))              \
    F(box_setup, "state@, lb[d], ub[d]", "make a block a state; a status.", NEED_BYTES(0, box_bytes(SIZE(d))),         \
      WHOLE_RESULT = box_setup(MEMORY(0), SIZE(d), REALS(1), REALS(2)))                                                \
    F(box_set_data, "state@BOX1, P[d,d]?, q[d]?", "new data, None for data that stay; a status.",                      \
      SIZE(d) >= LONG_FROM, WHOLE_RESULT = box_set_data(BOX, REALS(1), REALS(2)))                                      \
    F(box_start, "state@BOX1, x[d]", "begin a warm solve at x; a status.", 0, WHOLE_RESULT = box_start(BOX, REALS(1))) \
    F(box_solve, "state@BOX1, warm#0:1", "solve; a status.", SIZE(d) >= LONG_FROM,                                     \
      WHOLE_RESULT = box_solve(BOX, INT(1)))                                                                           \
    F(time_box, "state@BOX1, warm#0:1, " TIMED, "time updates and solves; a status.", 1,                               \
      WHOLE_RESULT = TIMED_BY(2, (&(TimedSolver){BOX, SIZE(d), update, WHOLE(1) ? solve_warm : solve_cold})))
MAKE_BINDINGS(box)
