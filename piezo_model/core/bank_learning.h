/* What the learners of a tile do; see bank.h. */
#ifndef CORE_BANK_LEARNING_H
#define CORE_BANK_LEARNING_H

#include "bank.h"
#include "learning.h"

/* Room of one thread: the block's rows, padded by zeros, and what it judged of them; states; the programs of a tile; the queue of those
 * that one system does not solve, with whose they are and how many systems they took; the solver for one lane. */
typedef struct {
    real *rows, *good, *play, *creep;
    BoxLanes program, queue;
    int32_t *owner, *rounds; /* of each lane of the queue; the owner is actuator + 1, 0 where there is none */
    real *P, *q, *lb, *ub;
    void *single;
} Workspace;

/* Take the outputs of the last drives; 1 in the lanes whose weights in use are new. */
CORE_API vec8 observe(const Bank *b, const Tile *t, vec8 y, void *room);
/* Wait for the optima that are still in the queue of this room. */
CORE_API void finish_optima(const Bank *b, void *room);

/* The optimum of each of these lanes becomes its candidate: at once where one system is enough, else when the queue is done with it. */
CORE_API void find_optima(const Bank *b, const Tile *t, const Workspace *w, vec8 which);
/* Wait for the candidates of the tiles from `first` to `last`. */
CORE_API void wait_for_optima(const Bank *b, const Workspace *w, int first, int last);

/* Lane by lane a where `which` is 1, else b. */
CORE_INLINE vec8 choose(vec8 which, vec8 a, vec8 b) { return where_less(zeros(), which, a, b); }
CORE_INLINE void put_where(vec8 which, real *to, vec8 value) { store(to, choose(which, value, load(to))); }

#define MEMORY(name) lane8(t->memory, name)
CORE_INLINE void copy_where(vec8 which, real *to, const real *from, int vectors)
{
    for (int i = 0; i < vectors; ++i) {
        put_where(which, to + i * LANES, load(from + i * LANES));
    }
}

CORE_INLINE real lower_bound(const Bank *b, int j)
{
    const Shape s = b->shape;
    return s.offset && j == b->d - 1 ? -REAL_INFINITY : j >= s.n && j < s.n + s.zones ? b->settings->min_slope : 0;
}

/* Move the states on by one drive in each lane. */
CORE_INLINE void advance_lanes(const Bank *b, vec8 x, real *play, real *creep)
{
    const int operators = b->shape.n + 1;
    for (int i = 0; i < operators; ++i) {
        const vec8 r = splat(b->r[i]);
        store(lane8(play, i), play8(x, r, load(lane8(play, i))));
        for (int j = 0; j < b->shape.rates; ++j) {
            real *const z = lane8(creep, j * operators + i);
            store(z, creep8(x, r, splat(b->a[j]), load(z)));
        }
    }
}

#endif
