/* The exact solver as Python calls it; see box.h. */
#include "box_fallback.h"
#include "clock.h"
#include "bindings_timed.h"

enum { LONG_FROM = 60 }; /* variables from which a solve takes longer than giving the interpreter away and back */

#define BOX ((Box[]){box_at(MEMORY(0))})

/* Where what Python looks at begins; five counts begin at the exchanges. */
static void places(Arguments *a, const Box *s)
{
    const Part parts[] = {{"answer", s->answer, s->d},
                          {"raw_q", s->raw_q, s->d},
                          {"scale", s->scale, s->d},
                          {"P", s->P, s->d * s->ld},
                          {"x", s->x, s->d},
                          {"g", s->g, s->d},
                          {"inverted", &s->head->inverted, 1},
                          {"singular", &s->head->singular, 1},
                          {"cap", &s->head->cap, 1},
                          {"counts", &s->head->exchanges, 3}};
    RETURN_PARTS(s->head, parts);
}

static int update(void *solver, const double *P, const double *q)
{
    const int status = P != NULL ? box_take_hessian(solver, P) : OK;
    return status == OK && q != NULL ? box_take_linear(solver, q) : status;
}

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

/* After a solve by the factorisation: put the variables to the given sides, and let the dual method find the way back.
 */
static int dual_from(const Box *s, const int64_t *sides)
{
    const Fallback f = fallback_at(s);
    for (int j = 0; j < s->d; ++j) {
        f.program.side[j] = s->lo[j] < s->hi[j] ? (double)sides[j] : LOWER;
    }
    const int status = box_dual_active_set(&f);
    memcpy(s->x, f.program.x, (size_t)s->d * sizeof(double));
    memcpy(s->g, f.program.g, (size_t)s->d * sizeof(double));
    return status;
}

static int factor_solve(void *memory, int d, const double *free, const double *P, double least, double *x)
{
    Arena arena = {memory};
    const Factor f = factor_at(&arena, d);
    int safe, count = 0;
    for (int i = 0; i < d; ++i) {
        f.rows[count] = i;
        count += free[i] > 0;
    }
    safe = factorise(&f, P, free, count, least) > 0;
    substitute_back(&f, count, x);
    return safe;
}

static void absorb_rows(double *P, double *q, double *c, int d, int64_t count, const double *rows, double forgetting)
{
    for (int64_t k = 0; k < count; ++k) {
        absorb(P, q, c, d, rows + k * (d + 1), forgetting);
    }
}

/* Steps that wait for the clock: what they take longer than they last is the machine's. */
static void time_nothing(int64_t lasting, int64_t steps, int64_t *nanoseconds)
{
    for (int64_t k = 0; k < steps; ++k) {
        const int64_t start = monotonic_ns();
        do {
            nanoseconds[k] = monotonic_ns() - start;
        } while (nanoseconds[k] < lasting);
    }
}

#define BINDINGS(F)                                                                                                    \
    F(box_bytes, "d#0:10000", "size of the state of the exact solver.", 0, WHOLE_RESULT = box_bytes(INT(0)))           \
    F(box_places, "state@BOX1", "where its vectors and counts stand.", 0, places(&a, BOX))                             \
    F(box_setup, "state@, lb[d], ub[d]", "make a block a state; a status.", NEED_BYTES(0, box_bytes(SIZE(d))),         \
      WHOLE_RESULT = box_setup(MEMORY(0), SIZE(d), REALS(1), REALS(2)))                                                \
    F(box_take, "state@BOX1, P[d,d]?, q[d]?", "new data, None for what stays; a status.", SIZE(d) >= LONG_FROM,        \
      WHOLE_RESULT = update(BOX, REALS(1), REALS(2)))                                                                  \
    F(box_start, "state@BOX1, x[d]", "begin a warm solve at x; a status.", 0, WHOLE_RESULT = box_start(BOX, REALS(1))) \
    F(box_solve, "state@BOX1, warm#0:1", "solve; a status.", SIZE(d) >= LONG_FROM,                                     \
      WHOLE_RESULT = box_solve(BOX, INT(1)))                                                                           \
    F(box_solve_factorised, "state@BOX1, warm#0:1", "solve without the inverse; a status.", SIZE(d) >= LONG_FROM,      \
      WHOLE_RESULT = box_solve_factorised(BOX, INT(1)))                                                                \
    F(box_dual_from, "state@BOX1, sides[d]q", "solve by the dual method alone; a status.", 0,                          \
      WHOLE_RESULT = dual_from(BOX, WHOLES(1)))                                                                        \
    F(factor_bytes, "d#1:1000", "size of the workspace that factor_solve needs.", 0,                                   \
      WHOLE_RESULT = factor_bytes(INT(0)))                                                                             \
    F(factor_solve, "workspace@, free[d], P[d,w], least, x[d]=",                                                       \
      "solve by the factor of P_FF, the right-hand side in column d of P; 1 if every pivot is safe.",                  \
      (NEED_BYTES(0, factor_bytes(SIZE(d))), NEED_SIZE(w, padded(SIZE(d) + 1))),                                       \
      WHOLE_RESULT = factor_solve(MEMORY(0), SIZE(d), REALS(1), REALS(2), NUMBER(3), REALS(4)))                        \
    F(time_box, "state@BOX1, warm#0:1, " TIMED, "time updates and solves; a status.", 1,                               \
      WHOLE_RESULT = TIMED_BY(2, (&(TimedSolver){BOX, SIZE(d), update, WHOLE(1) ? solve_warm : solve_cold})))          \
    F(box_follow, "state@BOX1, " FOLLOWED, "time a solve after each row, warm from the last sides; a status.", 1,      \
      WHOLE_RESULT = FOLLOWED_BY(1, (&(TimedSolver){BOX, SIZE(d), update, solve_warm}), NULL))                         \
    F(absorb, "P[d,d]=, q[d]=, c[1]=, rows[n,d+1], forgetting", "take rows into P, q and c.", LENGTH(n) > 10,          \
      absorb_rows(REALS(0), REALS(1), REALS(2), SIZE(d), LENGTH(n), REALS(3), NUMBER(4)))                              \
    F(time_nothing, "lasting#0:, nanoseconds[n]q=", "time steps that wait so many nanoseconds and do nothing else.",   \
      1, time_nothing(WHOLE(0), LENGTH(n), WHOLES(1)))
MAKE_BINDINGS(box)
