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

enum { STRIP = PARTS == 1 ? 4 : PARTS == 2 ? 2 : 1 }; /* vectors of two rows of the factor that stay in registers */

typedef struct {
    int d;
    num *U;        /* symmetric_nums(d + 1) */
    int32_t *rows; /* d: those that are free in some program, ascending */
    num *inverse;  /* d + 1: of each row of this list 1 / D_i, 0 where it is left out */
    num *L;        /* 2 (d + 1): of the two rows that are made, side by side */
    int32_t *at;   /* d + 1: where each row of the list stands in U */
} Factor;

CORE_INLINE int64_t factor_bytes(int d)
{
    return (int64_t)sizeof(num) * (symmetric_nums(d + 1) + 3 * NUMS(d + 1)) + 8 * (padded(d) + padded(d + 1));
}
CORE_INLINE Factor factor_at(Arena *arena, int d)
{
    Factor f = {.d = d};
    f.U = nums(arena, symmetric_nums(d + 1));
    f.inverse = nums(arena, NUMS(d + 1));
    f.L = nums(arena, 2 * NUMS(d + 1));
    f.rows = integers(arena, d);
    f.at = integers(arena, d + 1);
    return f;
}

/* So many vectors from j on of rows i and m, which follow `place` others. */
CORE_INLINE void strip_of_rows(Factor f, const num *P, int place, int i, int m, int j, int vectors)
{
    const int row = symmetric_row(f.d + 1, i), next = symmetric_row(f.d + 1, m);
    vec8 first[STRIP], second[STRIP];
    for (int c = 0; c < vectors; ++c) {
        first[c] = vector(P + row, j + c);
        second[c] = vector(P + next, j + c);
    }
    for (int k = 0; k < place; ++k) {
        const num *const above = f.U + f.at[k];
        const vec8 L_i = SPREAD(f.L[2 * k]), L_m = SPREAD(f.L[2 * k + 1]);
        for (int c = 0; c < vectors; ++c) {
            const vec8 u = vector(above, j + c);
            first[c] = sub_mul(first[c], L_i, u);
            second[c] = sub_mul(second[c], L_m, u);
        }
    }
    for (int c = 0; c < vectors; ++c) { /* the second before the first, which it may be */
        set_vector(f.U + next, j + c, sub_mul(second[c], SPREAD(f.L[2 * place + 1]), first[c]));
        set_vector(f.U + row, j + c, first[c]);
    }
}

/* 1/D of a pivot, 0 where its row is left out; where it is not above the share `least` of the diagonal of P, `safe`
 * becomes 0. */
CORE_INLINE num invert_pivot(num pivot, num diagonal, num free, real least, num *safe)
{
    const num divisor = choose(free, pivot, constant(1));
    *safe = if_less(times(constant(least), both(free, diagonal)), divisor, *safe, constant(0));
    return divided(free, divisor);
}

/* Factorise with the first `count` rows of the list, with the right-hand side in column d of P; 1 where every pivot D_i
 * is more than the share `least` of P_ii. Two rows are made at a time, and the entries of their pivots first: what
 * follows waits for the divisions alone. The last of an odd number is made beside itself. */
CORE_INLINE num factorise(const Factor *factor, const num *P, const num *free, int count, real least)
{
    const Factor f = *factor;
    const int vectors = VECTORS(f.d + 1);
    num safe = constant(1);
    for (int place = 0; place < count; place += 2) {
        const int i = f.rows[place], m = f.rows[place + (place + 1 < count)];
        const int row = symmetric_row(f.d + 1, i), next = symmetric_row(f.d + 1, m);
        int j = diagonal_vector(m); /* columns between i and m are free in no program */
        num ii = P[row + i], im = P[row + m], mm = P[next + m];
        for (int k = 0; k < place; ++k) {
            const num *const above = f.U + f.at[k];
            const num L_i = times(above[i], f.inverse[k]), L_m = times(above[m], f.inverse[k]);
            ii = minus_times(ii, L_i, above[i]);
            im = minus_times(im, L_i, above[m]);
            mm = minus_times(mm, L_m, above[m]);
            f.L[2 * k] = L_i;
            f.L[2 * k + 1] = L_m;
        }
        f.at[place] = row;
        f.at[place + 1] = next;
        f.inverse[place] = invert_pivot(ii, P[row + i], free[i], least, &safe);
        f.L[2 * place + 1] = times(im, f.inverse[place]);
        mm = minus_times(mm, f.L[2 * place + 1], im);
        f.inverse[place + 1] = invert_pivot(mm, P[next + m], m > i ? free[m] : constant(0), least, &safe);
        for (; j + STRIP <= vectors; j += STRIP) {
            strip_of_rows(f, P, place, i, m, j, STRIP);
        }
        switch (vectors - j) { /* a constant keeps them in registers */
        case 3:
            strip_of_rows(f, P, place, i, m, j, STRIP < 3 ? STRIP : 3);
            break;
        case 2:
            strip_of_rows(f, P, place, i, m, j, STRIP < 2 ? STRIP : 2);
            break;
        case 1:
            strip_of_rows(f, P, place, i, m, j, 1);
            break;
        }
    }
    return safe;
}

/* x = U^-1 of the right-hand side, zero where a program leaves a row out; what no program has is left alone. Two rows
 * at a time, and the first of an odd number beside itself. */
CORE_INLINE void substitute_back(const Factor *factor, int count, num *x)
{
    const Factor f = *factor;
    for (int place = count - 1; place >= 0; place -= 2) {
        const int before = place > 0 ? place - 1 : 0, i = f.rows[before], m = f.rows[place];
        const num *const row = f.U + f.at[before], *const next = f.U + f.at[place];
        num x_i = row[f.d], x_m = next[f.d];
        for (int b = count - 1; b > place; --b) {
            const int j = f.rows[b];
            x_i = minus_times(x_i, row[j], x[j]);
            x_m = minus_times(x_m, next[j], x[j]);
        }
        x_m = times(x_m, f.inverse[place]);
        x[i] = times(minus_times(x_i, row[m], x_m), f.inverse[before]);
        x[m] = x_m;
    }
}

#endif
