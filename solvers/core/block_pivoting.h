/* Block principal pivoting for   minimise 1/2 x'Px + q'x   over   lb <= x <= ub,   of one program or of eight at once.
 *
 * P is the upper triangle, by rows, of a matrix of order d + 1, as the Gram matrix of rows (xi, x) is one; what stands
 * in its last column is not read and is written over, and so is the lower triangle of a single program.
 */
#ifndef CORE_BLOCK_PIVOTING_H
#define CORE_BLOCK_PIVOTING_H

#include "factor.h"
#include "arena.h"

enum {
    MOST_ROUNDS = 24, /* systems after which a program is left to whoever can do more */
    GUESSED_FROM = 12 /* variables from which a guess costs less than the systems that it saves */
};

typedef struct {
    int d;
    num *data;         /* P, symmetric_nums(d + 1) */
    num *q, *diagonal; /* d; the second that of P */
    num *lb, *ub;      /* d */
    num *x, *g;        /* d: where it begins and what it found, and the gradient q + P x */
    num *side;         /* d: -1 at the lower bound, 1 at the upper, 0 free; where it begins and what it found */
    num *scale;        /* d: about P_jj^(-1/2), a power of two */
    num *free, *step;  /* d: of a linear system, 1 where a variable is free, and what it solves for */
    Factor factor;
} Pivoting;

CORE_INLINE int64_t pivoting_bytes(int d)
{
    return factor_bytes(d) + (int64_t)sizeof(num) * (symmetric_nums(d + 1) + 10 * NUMS(d));
}
CORE_INLINE Pivoting pivoting_at(Arena *arena, int d)
{
    Pivoting s;
    s.d = d;
    s.data = nums(arena, symmetric_nums(d + 1));
    s.q = nums(arena, NUMS(d));
    s.diagonal = nums(arena, NUMS(d));
    s.lb = nums(arena, NUMS(d));
    s.ub = nums(arena, NUMS(d));
    s.x = nums(arena, NUMS(d));
    s.g = nums(arena, NUMS(d));
    s.side = nums(arena, NUMS(d));
    s.scale = nums(arena, NUMS(d));
    s.free = nums(arena, NUMS(d));
    s.step = nums(arena, NUMS(d));
    s.factor = factor_at(arena, d);
    return s;
}

CORE_INLINE num *row_of(const Pivoting *s, int i) { return s->data + symmetric_row(s->d + 1, i); }
/* Take from g what products with whole rows put behind it: those with the last column of the data and what follows. */
CORE_INLINE void end_gradient(const Pivoting *s)
{
    for (int i = s->d; i < NUMS(s->d); ++i) {
        s->g[i] = constant(0);
    }
}

/* Take the data; 1 where the diagonal is positive and finite. To be called again where a lane has another program. */
CORE_API num N(pivoting_prepare)(const Pivoting *s);
/* Of the programs in `which`, guess the sides by coordinate descent, one step a variable, from the point of the box
 * next to 0. */
CORE_API void N(pivoting_guess)(const Pivoting *s, num which);
/* Bring every variable to its side, with the gradient; the bounds are finite where a side says that a variable is at
 * one. */
CORE_API void N(pivoting_place)(const Pivoting *s);
/* Bring what is free to its minimiser from there; 1 where every pivot is more than the share `least` of the diagonal of
 * P. */
CORE_API num N(pivoting_newton)(const Pivoting *s, real least);
/* What rounding may leave of an entry of S g that is zero. */
CORE_API num N(pivoting_rounding)(const Pivoting *s);
/* Exchange the sides that break a condition: how many, and in `residual` the largest |g_F| by the rounding of g,
 * infinite where x or g is. */
CORE_API num N(pivoting_exchange)(const Pivoting *s, num *residual);
/* Both; 1 where x is the minimiser. Programs in `broken` have another system to solve; one in neither has no answer. */
CORE_API num N(pivoting_round)(const Pivoting *s, num *broken);
#ifdef CORE_TILE
/* Let the program of a lane go on in a lane of another eight. */
CORE_API void pivoting_move(const Pivoting *from, int lane, const Pivoting *to, int into);
#endif

#endif
