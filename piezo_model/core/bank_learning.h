/* What the learners of a tile do; see bank.h. */
#ifndef CORE_BANK_LEARNING_H
#define CORE_BANK_LEARNING_H

#include "bank.h"
#include "learning.h"

/* Take the outputs of the last drives; 1 in the lanes whose weights in use are new. */
CORE_API vec8 observe(const Bank *b, const Tile *t, vec8 y, void *room);
/* Wait for the optima that are still in the queue of this room. */
CORE_API void finish_optima(const Bank *b, void *room);

/* Lane by lane a where `which` is 1, else b. */
CORE_INLINE vec8 choose(vec8 which, vec8 a, vec8 b) { return where_less(zeros(), which, a, b); }
CORE_INLINE void put_where(vec8 which, real *to, vec8 value) { store(to, choose(which, value, load(to))); }

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
