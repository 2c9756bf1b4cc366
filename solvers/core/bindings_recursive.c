/* The recursive solver as Python calls it; see recursive.h. */
#include "clock.h"
#include "bindings_timed.h"
#include "recursive.h"

#define RECURSIVE ((Recursive[]){recursive_at(MEMORY(0))})

/* The parts that Python reads; three counters begin at the exchanges. */
static void places(Arguments *a, const Recursive *s)
{
    const Part parts[] = {{"answer", s->answer, s->d},
                          {"origin", s->origin, s->d},
                          {"sign", s->sign, s->d},
                          {"is_free", s->is_free, s->d},
                          {"centre", s->centre, s->d},
                          {"rho", s->rho, s->d},
                          {"M", s->M, s->ld * s->ld},
                          {"G", s->G, s->ld * s->ld},
                          {"row_weight", &s->head->row_weight, 2},
                          {"cap", &s->head->cap, 1},
                          {"counts", &s->head->exchanges, 2},
                          {"since_refresh", &s->head->since_refresh, 1}};
    RETURN_PARTS(s->head, parts);
}

/* The status, after the answer is written. */
static int answered(Recursive *s, int status)
{
    recursive_answer(s);
    return status;
}

static int begin(Recursive *s, const double *P, const double *q)
{
    const int status = recursive_begin(s, P, q, 0, 0);
    return status == OK ? answered(s, status) : status;
}

static int take_rows(Recursive *s, int64_t count, const double *rows, double *answers, int64_t *nanoseconds)
{
    int status = OK;
    for (int64_t k = 0; k < count && (status == OK || status == CAPPED); ++k) {
        const int64_t start = monotonic_ns();
        status = recursive_append(s, rows + k * (s->d + 1));
        if (status == SINGULAR || status == CYCLING) {
            status = recursive_recover(s);
        }
        recursive_answer(s);
        memcpy(answers + k * s->d, s->answer, (size_t)s->d * sizeof(double));
        nanoseconds[k] = monotonic_ns() - start;
    }
    return status;
}

/* It starts again from P and q, which includes finding the optimum, so all of it is timed as the solve. */
typedef struct {
    Recursive *s;
    const double *P, *q;
} TimedRecursive;

static int update(void *solver, const double *P, const double *q)
{
    TimedRecursive *const t = solver;
    t->P = P;
    t->q = q;
    return OK;
}

static int solve(void *solver, const double *start, double *x)
{
    TimedRecursive *const t = solver;
    const int status = begin(t->s, t->P, t->q);
    (void)start;
    if (status == OK || status == CAPPED) {
        memcpy(x, t->s->answer, (size_t)t->s->d * sizeof(double));
    }
    return status;
}

#define BINDINGS(F)                                                                                                    \
    F(recursive_bytes, "d#0:10000", "size of the state of the recursive solver.", 0,                                   \
      WHOLE_RESULT = recursive_bytes(INT(0)))                                                                          \
    F(recursive_places, "state@SWP1", "offsets of its parts.", 0, places(&a, RECURSIVE))                               \
    F(recursive_setup, "state@, lb[d], ub[d], forgetting, row_weight, proximal", "make a block a state; a status.",    \
      NEED_BYTES(0, recursive_bytes(SIZE(d))),                                                                         \
      WHOLE_RESULT = recursive_setup(MEMORY(0), SIZE(d), REALS(1), REALS(2), NUMBER(3), NUMBER(4), NUMBER(5)))         \
    F(recursive_begin, "state@SWP1, P[d,d], q[d]", "start from these data; a status.", 1,                              \
      WHOLE_RESULT = begin(RECURSIVE, REALS(1), REALS(2)))                                                             \
    F(recursive_append, "state@SWP1, row[d+1]", "take a row (xi, x) and answer; a status.", 0,                         \
      Recursive *const s = RECURSIVE;                                                                                  \
      WHOLE_RESULT = answered(s, recursive_append(s, REALS(1))))                                                       \
    F(recursive_append_rows, "state@SWP1, rows[n,d+1], answers[n,d]=, nanoseconds[n]q=",                               \
      "append rows; solve from scratch after a breakdown. A status.", LENGTH(n) > 1,                                   \
      WHOLE_RESULT = take_rows(RECURSIVE, LENGTH(n), REALS(1), REALS(2), WHOLES(3)))                                   \
    F(recursive_recover, "state@SWP1", "start again from all data; a status.", 0, Recursive *const s = RECURSIVE;      \
      WHOLE_RESULT = answered(s, recursive_recover(s)))                                                                \
    F(recursive_refresh, "state@SWP1", "recompute the swept matrix; a status.", 0, Recursive *const s = RECURSIVE;     \
      WHOLE_RESULT = answered(s, recursive_refresh(s)))                                                                \
    F(recursive_error, "state@SWP1", "largest violation of the optimality conditions.", 0,                             \
      NUMBER_RESULT = recursive_error(RECURSIVE))                                                                      \
    F(time_recursive, "state@SWP1, " TIMED, "time starts from new data; a status.", 1,                                 \
      WHOLE_RESULT =                                                                                                   \
          TIMED_BY(1, (&(TimedSolver){(TimedRecursive[]){{RECURSIVE, NULL, NULL}}, SIZE(d), update, solve})))
MAKE_BINDINGS(recursive)
