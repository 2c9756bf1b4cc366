/* The row of the error model (5) for one sample, linear in the unknowns w:
 *
 *     E(k) = w'Xi(k) + x(k),   row = (x, Xi, x),   Xi = (H_r1[x] ... H_rn[x],  -S_r'[y] ...,  K_r0[x] ... K_rn[x], [1])
 *
 * with x on both sides, so that (x, Xi) and (Xi, x) are both contiguous. For slopes instead of weights, the next dead
 * zone outwards (`outer`) is subtracted from each one. The Gram matrix of rows is updated by blocks of rows,
 *
 *     gram <- fade gram + sum of row_k row_k'.
 *
 * Source: the paper's equations (3) to (5); K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_REGRESSORS_H
#define CORE_REGRESSORS_H

#include "operators.h"

typedef struct {
    Operators operators;
    real *low, *high;             /* limits of the dead zones, zone_lanes */
    real *outer_low, *outer_high; /* limits of the dead zones subtracted; -inf and inf for none */
} Regressors;

CORE_INLINE int row_width(Shape s) { return unknowns(s) + 1; }
/* Stride of rows in nums: vectors are written and read beyond the last column. */
CORE_INLINE int row_nums(Shape s) { return NUMS(row_width(s) + 1) + NUMS(LANES); }
CORE_INLINE Regressors regressors_at(Arena *arena, Shape s)
{
    Regressors p;
    const ArenaField fields[] = {{&p.low, zone_lanes(s)},
                                 {&p.high, zone_lanes(s)},
                                 {&p.outer_low, zone_lanes(s)},
                                 {&p.outer_high, zone_lanes(s)}};
    p.operators = operators_at(arena, s);
    LAY_OUT(arena, fields);
    return p;
}

/* Write the row of one sample, zeros if it does not count, and advance the states. Vectors are written from left to
 * right, so that each one overwrites the padding of the one before. */
CORE_INLINE void write_row(const Regressors *p, Shape s, num counts, num x, num y, num *play, num *creep, num *row)
{
    const vec8 weight = SPREAD(counts), input = SPREAD(x), output = SPREAD(y);
    const int k = play_vectors(s);
    num *column = row;
    for (int i = 0; i < k; ++i) {
        const vec8 z = play8(input, PARAMETER(p->operators.r, i), vector(play, i));
        set_vector(play, i, z);
        set_vector(column, i, mul(weight, z)); /* the play of threshold zero is x */
    }
    column += s.n + 1;
    for (int i = 0; i < VECTORS(s.zones); ++i) {
        const vec8 inner = dead_zone8(output, PARAMETER(p->low, i), PARAMETER(p->high, i));
        const vec8 outer = dead_zone8(output, PARAMETER(p->outer_low, i), PARAMETER(p->outer_high, i));
        set_vector(column, i, mul(weight, sub(outer, inner)));
    }
    column += s.zones;
    for (int i = 0; s.rates > 0 && i < k; ++i) {
        const vec8 r = PARAMETER(p->operators.r, i);
        vec8 sum = zeros();
        for (int j = 0; j < s.rates; ++j) {
            const vec8 z = vector(creep, j * k + i);
            sum = add(sum, z);
            set_vector(creep, j * k + i, creep8(input, r, splat(p->operators.a[j]), z));
        }
        set_vector(column, i, mul(weight, sum));
    }
    if (s.offset) {
        row[row_width(s) - 1] = counts;
    }
    row[row_width(s)] = times(counts, x);
}

/* Size of the block of gram that stays in registers. */
#ifdef CORE_TILE
enum { GRAM_ROWS = REGISTERS == 1 ? 4 : 2, GRAM_VECTORS = GRAM_ROWS };
#else
enum { GRAM_ROWS = REGISTERS == 1 ? 8 : 4, GRAM_VECTORS = 1 };
#endif

/* gram <- fade gram + sum of row_k row_k' over rows of `width` entries, `stride` nums apart. */
CORE_INLINE void gram_add(num *gram, int width, num fade, const num *rows, int stride, int count)
{
    const int columns = VECTORS(width);
    for (int i = 0; i < width; i += GRAM_ROWS) {
        for (int j = diagonal_vector(i); j < columns; j += GRAM_VECTORS) {
            vec8 sum[GRAM_ROWS][GRAM_VECTORS];
            for (int p = 0; p < GRAM_ROWS; ++p) {
                for (int q = 0; q < GRAM_VECTORS; ++q) {
                    sum[p][q] = zeros();
                }
            }
            for (int t = 0; t < count; ++t) {
                const num *const row = rows + (size_t)t * (size_t)stride;
                for (int p = 0; p < GRAM_ROWS; ++p) {
                    const vec8 left = SPREAD(row[i + p]);
                    for (int q = 0; q < GRAM_VECTORS; ++q) {
                        sum[p][q] = plus_product(sum[p][q], left, vector(row, j + q));
                    }
                }
            }
            for (int p = 0; p < GRAM_ROWS && i + p < width; ++p) {
                num *const to = gram + symmetric_row(width, i + p);
                for (int q = 0; q < GRAM_VECTORS; ++q) {
                    if (j + q >= diagonal_vector(i + p) && j + q < columns) {
                        set_vector(to, j + q, flushed8(plus_product(sum[p][q], vector(to, j + q), SPREAD(fade))));
                    }
                }
            }
        }
    }
}

#endif
