/* Many box programs of one size as Python calls them, one after the other (box.h) or eight at a time
 * (block_pivoting.h).
 *
 * A lane whose program is done takes the next one. Cold that is faster than one after the other up to about d = 18, and
 * slower at d = 60, where a factor for each lane no longer fits into the first-level cache.
 */
#define CORE_TILE
#include "block_pivoting.h"
#include "box.h"
#include "face_solvers.h"

/* Eight programs and the room to solve them, then the state of the exact solver for a lane that is left. */
typedef struct {
    Pivoting lanes;
    void *single;
} Workspace;

static Workspace workspace_at(void *memory, int d)
{
    Room room = {memory};
    Workspace w;
    w.lanes = pivoting_at(&room, d);
    w.single = room.at;
    return w;
}

FACE(box_many_bytes)
{
    const int d = (int)take_integer(a, 1, 1000);
    return finish_integer(a, good(a) ? pivoting_bytes(d) + box_bytes(d) : 0);
}

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
static void solve_in_lanes(Batch *many, const Pivoting *s, Box *single, int first, int last)
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

/* The minimisers x (B, d) of the programs (B, d, d), (B, d), from `first` up to `last`; statuses; how many were solved
 * alone. In lanes a P is taken for symmetric and bounds for lb < ub. */
FACE(box_many)
{
    const double *const P = take_array(a, ANY_LENGTH, ANY_LENGTH);
    const int programs = (int)taken_length(a);
    const double *const q = take_array(a, programs, ANY_LENGTH);
    const int d = good(a) ? (int)a->views[1].shape[1] : 1;
    if (good(a) && a->views[0].shape[1] != (Py_ssize_t)d * d) {
        refuse(a, "P has d times d numbers a program");
    }
    const double *const lb = take_array(a, programs, d);
    const double *const ub = take_array(a, programs, d);
    double *const x = take_output(a, programs, d);
    int *const statuses = take_ints(a, programs);
    void *const room = take_state(a, 0);
    need_bytes(a, 6, pivoting_bytes(d) + box_bytes(d));
    const int first = (int)take_integer(a, 0, programs);
    const int last = (int)take_integer(a, first, programs);
    const int in_lanes = (int)take_integer(a, 0, 1);
    if (!good(a)) {
        return finish(a, NULL);
    }
    Batch many = {d, 0, P, q, lb, ub, x, statuses};
    Workspace w = workspace_at(room, d);
    begin_long_if(a, 1);
    if (first < last) {
        box_setup(w.single, d, lb + (size_t)first * (size_t)d, ub + (size_t)first * (size_t)d);
    }
    Box single = box_at(w.single);
    if (in_lanes && first < last) {
        solve_in_lanes(&many, &w.lanes, &single, first, last);
    }
    for (int b = first; b < last && !in_lanes; ++b) {
        solve_one(&many, &single, b);
    }
    return finish_integer(a, many.alone);
}
