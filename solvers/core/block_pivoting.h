/* Block principal pivoting for   minimise 1/2 x'Px + q'x   over   lb <= x <= ub,   of one program or of eight at once.
 *
 * P is the upper triangle, by rows, of a matrix of order d + 1, as the Gram matrix of rows (xi, x) is one; what stands in its last column
 * is not read and is written over.
 */
#ifndef CORE_BLOCK_PIVOTING_H
#define CORE_BLOCK_PIVOTING_H

#include "num.h"
#include "room.h"

enum { MOST_ROUNDS = 24 }; /* systems after which a program is left to whoever can do more */

typedef struct {
    int d;
    num *data;         /* P, symmetric_nums(d + 1) */
    num *q, *diagonal; /* d; the second that of P */
    num *lb, *ub, *x;  /* d */
    num *side;         /* d: -1 at the lower bound, 1 at the upper, 0 free; where it begins and what it found */
    num *U, *free, *inverse, *column, *g, *scale; /* room: symmetric_nums(d + 1), d + 1, and d each */
    num *whole; /* P by rows, of a single program */
} Pivoting;

CORE_INLINE int64_t pivoting_nums(int d) { return 2 * (int64_t)symmetric_nums(d + 1) + 11 * NUMS(d + 1) + (WIDTH == 1 ? d * NUMS(d) : 0); }
CORE_INLINE Pivoting pivoting_at(Room *room, int d)
{
    const int k = NUMS(d + 1);
    Pivoting s;
    s.d = d;
    s.data = nums(room, symmetric_nums(d + 1));
    s.U = nums(room, symmetric_nums(d + 1));
    s.lb = nums(room, k);
    s.ub = nums(room, k);
    s.x = nums(room, k);
    s.side = nums(room, k);
    s.free = nums(room, k);
    s.inverse = nums(room, k);
    s.column = nums(room, k);
    s.g = nums(room, k);
    s.scale = nums(room, k);
    s.q = nums(room, k);
    s.diagonal = nums(room, k);
    s.whole = WIDTH == 1 ? nums(room, d * NUMS(d)) : NULL;
    return s;
}

/* Take the data; 1 where the diagonal is positive and finite. To be called again where a lane has another program. */
CORE_API num N(pivoting_prepare)(const Pivoting *s);
/* Solve one system with the sides as they are, and exchange; 1 where x is the minimiser. Programs in `broken` have another system to
 * solve; one in neither has no answer. The bounds are finite where a side says that a variable is at one, and lb < ub. */
CORE_API num N(pivoting_round)(const Pivoting *s, num *broken);
#ifdef CORE_TILE
/* Let the program of a lane go on in a lane of another eight. */
CORE_API void pivoting_move(const Pivoting *from, int lane, const Pivoting *to, int into);
#endif

#endif
