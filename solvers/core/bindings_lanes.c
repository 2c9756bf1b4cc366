/* Many box programs of one size as Python calls them, one after the other (box.h) or eight at a time
 * (block_pivoting.h).
 *
 * A lane whose program is done takes the next one. Cold that is faster than one after the other up to about d = 18, and
 * slower at d = 60, where a factor for each lane no longer fits into the first-level cache.
 */
#define CORE_TILE
#include "block_pivoting.h"
#include "box.h"
#include "bindings.h"

static void put(num *to, int i, int l, real a) { ((real *)(to + i))[l] = a; }

/* Put a program into lane l. */
static void fill_lane(const Pivoting *s, int l, const double *P, const double *q, const double *lb, const double *ub)
{
    const int d = s->d;
    for (int i = 0; i < d; ++i) {
        for (int j = i; j < d; ++j) {
            put(s->data + symmetric_row(d + 1, i), j, l, P[i * d + j]);
        }
        put(s->diagonal, i, l, P[i * d + i]);
        put(s->q, i, l, q[i]);
        put(s->lb, i, l, lb[i]);
        put(s->ub, i, l, ub[i]);
        put(s->x, i, l, 0);
        put(s->side, i, l, 0);
    }
}

/* B programs (B, d, d), (B, d), their minimisers x (B, d), how they ended, and how many were solved alone. */
typedef struct {
    int d, alone;
    const double *P, *q, *lb, *ub;
    double *x;
    int *statuses;
} Batch;

static void solve_one(Batch *many, Box *single, int b)
{
    const size_t vector = (size_t)b * (size_t)many->d;
    many->statuses[b] = box_solve_anew(single, many->P + vector * (size_t)many->d, many->q + vector, many->lb + vector,
                                       many->ub + vector);
    memcpy(many->x + vector, single->answer, (size_t)many->d * sizeof(double));
    ++many->alone;
}

/* Eight at a time: a lane whose program is done takes the next one, so that none waits for another. */
static void solve_simd_batched(Batch *many, const Pivoting *s, Box *single, int first, int last)
{
    const int d = many->d;
    int next = first, busy = 0, program[LANES], rounds[LANES] = {0};
    real solved[LANES], broken[LANES];
    for (int l = 0; l < LANES; ++l) {
        program[l] = -1;
    }
    do {
        real begins[LANES] = {0};
        num more, fine;
        for (int l = 0; l < LANES && next < last; ++l) {
            if (program[l] < 0) {
                const size_t vector = (size_t)next * (size_t)d;
                fill_lane(s, l, many->P + vector * (size_t)d, many->q + vector, many->lb + vector, many->ub + vector);
                program[l] = next++;
                begins[l] = 1;
                rounds[l] = 0;
                ++busy;
            }
        }
        fine = tile_pivoting_prepare(s);
        if (d >= GUESSED_FROM && any(load(begins))) {
            tile_pivoting_guess(s, load(begins));
        }
        store(solved, both(fine, tile_pivoting_round(s, &more)));
        store(broken, both(fine, more));
        for (int l = 0; l < LANES; ++l) {
            const int b = program[l];
            if (b < 0 || (broken[l] > 0 && ++rounds[l] < MOST_ROUNDS)) {
                continue;
            }
            if (solved[l] > 0) {
                for (int i = 0; i < d; ++i) {
                    many->x[(size_t)b * (size_t)d + (size_t)i] = ((const real *)(s->x + i))[l];
                }
                many->statuses[b] = OK;
            } else {
                solve_one(many, single, b);
            }
            program[l] = -1;
            --busy;
        }
    } while (busy > 0 || next < last);
}

/* The programs from `first` up to `last`, in a workspace for eight and then for the exact solver; how many were solved
 * alone. In lanes a P is taken for symmetric and bounds for lb < ub. */
static int solve_many(Batch *many, void *memory, int first, int last, int simd_batched)
{
    const size_t vector = (size_t)first * (size_t)many->d;
    Arena arena = {memory};
    const Pivoting lanes = pivoting_at(&arena, many->d);
    if (first < last) {
        box_setup(arena.at, many->d, many->lb + vector, many->ub + vector);
        Box single = box_at(arena.at);
        if (simd_batched) {
            solve_simd_batched(many, &lanes, &single, first, last);
        }
        for (int b = first; b < last && !simd_batched; ++b) {
            solve_one(many, &single, b);
        }
    }
    return many->alone;
}

#define BINDINGS(F)                                                                                                    \
    F(box_many_bytes, "d#1:1000", "size of the workspace that box_many needs.", 0,                                     \
      WHOLE_RESULT = pivoting_bytes(INT(0)) + box_bytes(INT(0)))                                                       \
    F(box_many,                                                                                                        \
      "q[n,d], P[n,dd], lb[n,d], ub[n,d], x[n,d]=, statuses[n]i=, workspace@, first#0:n, last#0:n, lanes#0:1",         \
      "minimisers x of programs from first up to last, one by one or in lanes; how many one by one.",                  \
      NEED_BYTES(6, pivoting_bytes(SIZE(d)) + box_bytes(SIZE(d))) + 1,                                                 \
      WHOLE_RESULT =                                                                                                   \
          solve_many(&(Batch){SIZE(d), 0, REALS(1), REALS(0), REALS(2), REALS(3), REALS(4), (int *)MEMORY(5)},         \
                     MEMORY(6), INT(7), INT(8), INT(9)))
MAKE_BINDINGS(lanes)
