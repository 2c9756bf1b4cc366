/* Eight box programs of one size at once, one in each lane:   minimise 1/2 x'Px + q'x   over   lb <= x <= ub.
 *
 * Every number below is eight of them, one a program. P and q stand together as the upper triangle, by rows, of the matrix (P q; q' .)
 * of order d + 1, which is what a Gram matrix of rows (xi, x) is; its last entry is not read.
 */
#ifndef CORE_BOX_LANES_H
#define CORE_BOX_LANES_H

#include "room.h"

enum { BOX_ROUNDS = 24 }; /* systems after which a lane is left to whoever can do more */

typedef struct {
    int d;
    real *data;          /* P and q, triangle(d + 1) */
    real *lb, *ub, *x;   /* d */
    real *side;          /* d: -1 at the lower bound, 1 at the upper, 0 free; where it begins and what it found */
    real *solved;        /* one vector: 1 where x is the minimiser */
    real *U, *free, *inverse, *column, *g, *scale; /* room: triangle(d + 1), and d each */
} BoxLanes;

/* Entries of the upper triangle of a matrix of this order. */
CORE_INLINE int triangle(int order) { return order * (order + 1) / 2; }
/* Where row i of such a triangle would have its column 0. */
CORE_INLINE int triangle_row(int order, int i) { return i * (2 * order - i - 1) / 2; }

/* Room that a solve needs besides the program, in numbers. */
CORE_INLINE int box_lanes_room(int d) { return LANES * (triangle(d + 1) + 5 * d); }
CORE_INLINE real *lane8(real *v, int i) { return v + (size_t)i * LANES; }

CORE_INLINE void box_lanes_take_room(BoxLanes *s, Room *room)
{
    s->U = reals(room, triangle(s->d + 1), LANES);
    s->free = reals(room, s->d, LANES);
    s->inverse = reals(room, s->d, LANES);
    s->column = reals(room, s->d, LANES);
    s->g = reals(room, s->d, LANES);
    s->scale = reals(room, s->d, LANES);
}

/* Solve from the sides as they are; how many systems that took. A lane whose `solved` is 0 afterwards has no answer. The bounds are
 * finite where a side says that a variable is at one, and lb < ub. */
CORE_API int box_lanes_solve(const BoxLanes *s);
/* Solve one system and exchange; 1 where x is the minimiser. The lanes in `broken` have another system to solve; a lane in neither has
 * no answer. */
CORE_API vec8 box_lanes_round(const BoxLanes *s, vec8 *broken);
/* Let the program of a lane go on in a lane of another eight. */
CORE_API void box_lanes_move(const BoxLanes *from, int lane, const BoxLanes *to, int into);

#endif
