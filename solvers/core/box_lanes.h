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
    real *U, *free, *inverse, *column, *g, *scale; /* room: triangle(d + 1), and d each */
} BoxLanes;

/* Entries of the upper triangle of a matrix of this order. */
CORE_INLINE int triangle(int order) { return order * (order + 1) / 2; }
/* Where row i of such a triangle would have its column 0. */
CORE_INLINE int triangle_row(int order, int i) { return i * (2 * order - i - 1) / 2; }

CORE_INLINE real *lane8(real *v, int i) { return v + (size_t)i * LANES; }

/* Eight programs and the room to solve them: how many numbers that is, and where they are. */
CORE_INLINE int64_t box_lanes_numbers(int d) { return LANES * (2 * (int64_t)triangle(d + 1) + 9 * (int64_t)d); }
CORE_INLINE BoxLanes box_lanes_at(Room *room, int d)
{
    BoxLanes s;
    s.d = d;
    s.data = reals(room, triangle(d + 1), LANES);
    s.lb = reals(room, d, LANES);
    s.ub = reals(room, d, LANES);
    s.x = reals(room, d, LANES);
    s.side = reals(room, d, LANES);
    s.U = reals(room, triangle(d + 1), LANES);
    s.free = reals(room, d, LANES);
    s.inverse = reals(room, d, LANES);
    s.column = reals(room, d, LANES);
    s.g = reals(room, d, LANES);
    s.scale = reals(room, d, LANES);
    return s;
}

/* Solve one system with the sides as they are, and exchange; 1 where x is the minimiser. The lanes in `broken` have another system to
 * solve; a lane in neither has no answer. The bounds are finite where a side says that a variable is at one, and lb < ub. */
CORE_API vec8 box_lanes_round(const BoxLanes *s, vec8 *broken);
/* Let the program of a lane go on in a lane of another eight. */
CORE_API void box_lanes_move(const BoxLanes *from, int lane, const BoxLanes *to, int into);

#endif
