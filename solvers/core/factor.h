/* P_FF = L D L' of one symmetric matrix or of eight, without the rows and columns of the variables that are not free,
 * and L^-1 of a right-hand side, which is one column more.
 *
 * With U = D L' by rows, and i and k < i free, row i is
 *
 *     U_i = P_i - sum of L_ik U_k,    L_ik = U_ki / D_k,    D_i = U_ii.
 *
 * Rows and columns keep their places. A row that one program leaves out and that of another lane needs has 1/D_i = 0,
 * and so takes part in nothing; what stands in the column of a variable that is not free, or before the diagonal, is
 * read by nobody. Every entry is updated in the order of the rows above it, and there is no sum across lanes, so that a
 * program has the same answer alone and in a lane.
 *
 * Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., sections 4.1 and 4.2.
 */
#ifndef CORE_FACTOR_H
#define CORE_FACTOR_H

#include "num.h"

enum { STRIP = PARTS == 1 ? 8 : PARTS == 2 ? 4 : 2 }; /* vectors of a row of the factor that stay in registers */

typedef struct {
    int d;
    num *U;        /* symmetric_nums(d + 1) */
    num *inverse;  /* d: 1 / D_i, 0 where row i is left out */
    num *L;        /* d: a row of L */
    int32_t *rows; /* d: those that are free in some program, ascending */
} Factor;

CORE_INLINE int64_t factor_bytes(int d)
{
    return (int64_t)sizeof(num) * (symmetric_nums(d + 1) + 2 * NUMS(d)) + 8 * padded(d);
}
CORE_INLINE Factor factor_at(Arena *arena, int d)
{
    Factor f = {.d = d};
    f.U = nums(arena, symmetric_nums(d + 1));
    f.inverse = nums(arena, NUMS(d));
    f.L = nums(arena, NUMS(d));
    f.rows = integers(arena, d);
    return f;
}

/* So many vectors from j on of the row at this place of the list. */
CORE_INLINE void strip_of_row(Factor f, const num *P, int place, int j, int vectors)
{
    const int row = symmetric_row(f.d + 1, f.rows[place]);
    vec8 sum[LANES];
    for (int c = 0; c < vectors; ++c) {
        sum[c] = vector(P + row, j + c);
    }
    for (int k = 0; k < place; ++k) {
        const num *const above = f.U + symmetric_row(f.d + 1, f.rows[k]);
        const vec8 share = SPREAD(f.L[k]);
        for (int c = 0; c < vectors; ++c) {
            sum[c] = sub_mul(sum[c], share, vector(above, j + c));
        }
    }
    for (int c = 0; c < vectors; ++c) {
        set_vector(f.U + row, j + c, sum[c]);
    }
}

/* Factorise with the first `count` rows of the list, with the right-hand side in column d of P; 1 where every pivot D_i
 * is more than the share `least` of P_ii. */
CORE_INLINE num factorise(const Factor *factor, const num *P, const num *free, int count, real least)
{
    const Factor f = *factor;
    const int vectors = VECTORS(f.d + 1);
    num safe = constant(1);
    for (int place = 0; place < count; ++place) {
        const int i = f.rows[place], row = symmetric_row(f.d + 1, i);
        int j = diagonal_vector(i);
        for (int k = 0; k < place; ++k) {
            f.L[k] = times(f.U[symmetric_row(f.d + 1, f.rows[k]) + i], f.inverse[f.rows[k]]);
        }
        for (; j + STRIP <= vectors; j += STRIP) {
            strip_of_row(f, P, place, j, STRIP);
        }
        switch (vectors - j) { /* a constant keeps them in registers */
        case 7:
            strip_of_row(f, P, place, j, 7);
            break;
        case 6:
            strip_of_row(f, P, place, j, 6);
            break;
        case 5:
            strip_of_row(f, P, place, j, 5);
            break;
        case 4:
            strip_of_row(f, P, place, j, 4);
            break;
        case 3:
            strip_of_row(f, P, place, j, 3);
            break;
        case 2:
            strip_of_row(f, P, place, j, 2);
            break;
        case 1:
            strip_of_row(f, P, place, j, 1);
            break;
        }
        const num pivot = choose(free[i], f.U[row + i], constant(1));
        safe = if_less(times(constant(least), both(free[i], P[row + i])), pivot, safe, constant(0));
        f.inverse[i] = divided(free[i], pivot);
    }
    return safe;
}

/* x = U^-1 of the right-hand side, zero where a program leaves a row out; what no program has is left alone. */
CORE_INLINE void substitute_back(const Factor *factor, int count, num *x)
{
    const Factor f = *factor;
    for (int place = count - 1; place >= 0; --place) {
        const num *const row = f.U + symmetric_row(f.d + 1, f.rows[place]);
        num sum = row[f.d];
        for (int b = count - 1; b > place; --b) {
            sum = minus_times(sum, row[f.rows[b]], x[f.rows[b]]);
        }
        x[f.rows[place]] = times(sum, f.inverse[f.rows[place]]);
    }
}

#endif
