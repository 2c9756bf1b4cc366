/* The row of the error model (5) that one sample gives, linear in the unknowns w:
 *
 *     E(k) = w'Xi(k) + x(k),   row = (x, Xi),   Xi = (H_r1[x] ... H_rn[x],  -S_r'[y] ...,  K_r0[x] ... K_rn[x],  [1])
 *
 * For slopes instead of weights, each dead zone has the next one outwards taken off (`outer`).
 *
 * Source: the paper's equation (5); K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_REGRESSORS_H
#define CORE_REGRESSORS_H

#include "operators.h"

typedef struct {
    Operators operators;
    real *low, *high;             /* of the dead zones, zone_lanes */
    real *outer_low, *outer_high; /* of what is taken off; -inf and inf where nothing is */
} Regressors;

CORE_INLINE int row_width(Shape s) { return unknowns(s) + 1; }
/* Length of a row in memory: blocks of eight are written and read beyond the last column. */
CORE_INLINE int row_stride(Shape s) { return padded(row_width(s) + LANES); }

CORE_INLINE Regressors take_regressors(Room *room, Shape s)
{
    Regressors p;
    p.operators = take_operators(room, s);
    p.low = reals(room, 1, zone_lanes(s));
    p.high = reals(room, 1, zone_lanes(s));
    p.outer_low = reals(room, 1, zone_lanes(s));
    p.outer_high = reals(room, 1, zone_lanes(s));
    return p;
}

/* Write the row of one sample, and move the states on. Blocks are written from left to right, so that each one overwrites the
 * padding of the one before it. */
CORE_INLINE void regressor_row(const Regressors *p, Shape s, real x, real y, real *play, real *creep, real *row)
{
    const vec8 input = splat(x), output = splat(y);
    real *column = row + s.n + 1;
    for (int i = 0; i < lanes(s); i += LANES) {
        const vec8 z = play8(input, load(p->operators.r + i), load(play + i));
        store(play + i, z);
        store(row + i, z);
    }
    for (int i = 0; i < zone_lanes(s); i += LANES) {
        const vec8 inner = dead_zone8(output, load(p->low + i), load(p->high + i));
        store(column + i, sub(dead_zone8(output, load(p->outer_low + i), load(p->outer_high + i)), inner));
    }
    column += s.zones;
    for (int i = 0; s.rates > 0 && i < lanes(s); i += LANES) {
        const vec8 r = load(p->operators.r + i);
        vec8 total = zeros();
        for (int j = i; j < creep_lanes(s); j += lanes(s)) {
            const vec8 z = load(creep + j);
            total = add(total, z);
            store(creep + j, creep8(input, r, load(p->operators.a + j), z));
        }
        store(column + i, total);
    }
    if (s.offset) {
        row[row_width(s) - 1] = 1;
    }
}

#endif
