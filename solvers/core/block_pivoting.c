/* A guess of which variables F are free and which A sit at a bound leaves one candidate, x_A at its bounds and
 *
 *     P_FF x_F = -(q_F + P_FA x_A).
 *
 * It is the minimiser iff lb <= x_F <= ub and the gradient g = q + P x holds every bound: g >= 0 at a lower, g <= 0 at an upper one. Each
 * round exchanges all variables that break this (Judice & Pires, Computers & Operations Research 21 (1994) 587). Programs that are solved
 * side by side differ in F and share every instruction: the system is solved at full size, with the rows and columns of A replaced by
 * those of the identity,
 *
 *     ( P_FF  0 ) ( x_F )     ( -(q_F + P_FA x_A) )
 *     (  0    I ) ( x_A )  =  (        x_A        ),
 *
 * as U'D^-1 U row by row, the right-hand side being one column more. Every entry is updated in the order of the rows above it, and there is
 * no sum across lanes, so that a program has the same answer alone and in a lane. One that is done repeats its last round to the last
 * bit, so what the others do changes nothing in it.
 *
 * Tolerances are in the variables z = x / S with S P S of unit diagonal up to a factor of two: the rounding of S g is about d eps max(|z|, |S q|).
 * A multiplier within it counts as zero, which keeps ties from cycling; a bound has no tolerance. A program is solved when no condition is
 * broken and S g_F is rounding. Pivoting may cycle, and has no safe pivots where P is near singular: such a program is left unsolved.
 */
#include "block_pivoting.h"

enum { STRIP = PARTS == 1 ? 8 : PARTS == 2 ? 4 : 2 }; /* vectors of a row of the factor that stay in registers */
#define SAFE_PIVOT ((real)1e-13) /* least share of the diagonal of P that a pivot has */
#define RESIDUAL ((real)64)      /* times the rounding of g: so much of g_F may be left */
#define SMALLEST ((real)1e-30)   /* least diagonal */

CORE_INLINE num *row_of(const Pivoting *s, num *matrix, int i) { return matrix + symmetric_row(s->d + 1, i); }
/* The largest of a vector's lanes where these are entries of one program. */
CORE_INLINE num largest_entry(vec8 a)
{
#ifdef CORE_TILE
    return a;
#else
    return largest8(a);
#endif
}

num N(pivoting_prepare)(const Pivoting *s)
{
    const int d = s->d;
    num fine = constant(1);
    for (int i = 0; i < d; ++i) {
        fine = both(fine, both(less(constant(SMALLEST), s->diagonal[i]), is_finite(s->diagonal[i])));
#ifndef CORE_TILE
        for (int j = i; j < d; ++j) {
            s->whole[i * NUMS(d) + j] = s->whole[j * NUMS(d) + i] = row_of(s, s->data, i)[j];
        }
#endif
    }
    for (int i = 0; i < VECTORS(d); ++i) {
        set_vector(s->scale, i, root_scale(vector(s->diagonal, i)));
    }
    return fine;
}

/* g = q + P x, every entry in the order of the columns. */
static void gradient(const Pivoting *s)
{
    const int d = s->d;
#ifdef CORE_TILE
    int i = 0;
    memcpy(s->g, s->q, sizeof(num) * (size_t)d);
    for (; i + 1 < d; i += 2) { /* two rows at a time */
        const num *const row = row_of(s, s->data, i), *const next = row_of(s, s->data, i + 1);
        const num x = s->x[i], x_next = s->x[i + 1];
        num sum = plus_times(plus_times(s->g[i], row[i], x), row[i + 1], x_next);
        num sum_next = plus_times(plus_times(s->g[i + 1], row[i + 1], x), next[i + 1], x_next);
        for (int j = i + 2; j < d; ++j) {
            sum = plus_times(sum, row[j], s->x[j]);
            sum_next = plus_times(sum_next, next[j], s->x[j]);
            s->g[j] = plus_times(plus_times(s->g[j], row[j], x), next[j], x_next);
        }
        s->g[i] = sum;
        s->g[i + 1] = sum_next;
    }
    if (i < d) {
        s->g[i] = plus_times(s->g[i], row_of(s, s->data, i)[i], s->x[i]);
    }
#else
    for (int i = 0; i < VECTORS(d); i += 2) {
        const int pair = i + 1 < VECTORS(d);
        vec8 sum = vector(s->q, i), sum_next = vector(s->q, i + pair);
        for (int j = 0; j < d; ++j) {
            const num *const column = s->whole + j * NUMS(d);
            const vec8 x = splat(s->x[j]);
            sum = plus_product(sum, vector(column, i), x);
            sum_next = plus_product(sum_next, vector(column, i + pair), x);
        }
        set_vector(s->g, i, sum);
        if (pair) {
            set_vector(s->g, i + 1, sum_next);
        }
    }
#endif
}

/* So many vectors from j on of row i of the factor: U_ij = P_ij - sum over k < i of (U_ki / D_k) U_kj, zero where i or j is at a bound. */
CORE_INLINE void strip_of_row(const Pivoting *s, int i, int j, int vectors)
{
    const num *const source = row_of(s, s->data, i);
    num *const to = row_of(s, s->U, i);
    const vec8 is_free = SPREAD(s->free[i]);
    vec8 sum[LANES];
    for (int c = 0; c < vectors; ++c) {
        sum[c] = vector(source, j + c);
    }
    for (int k = 0; k < i; ++k) {
        const num *const above = row_of(s, s->U, k);
        const vec8 share = SPREAD(s->column[k]);
        for (int c = 0; c < vectors; ++c) {
            sum[c] = less_product(sum[c], share, vector(above, j + c));
        }
    }
    for (int c = 0; c < vectors; ++c) {
        set_vector(to, j + c, mul(mul(is_free, vector(s->free, j + c)), sum[c]));
    }
}

/* Factorise with the sides as they are, x_A at its bounds and g there for x_F = 0; 1 where every pivot was safe. */
static num factorise(const Pivoting *s)
{
    const int d = s->d, vectors = VECTORS(d + 1);
    num safe = constant(1);
    for (int i = 0; i < d; ++i) {
        num *const row = row_of(s, s->U, i);
        int j = diagonal_vector(i);
        num pivot;
        for (int k = 0; k < i; ++k) {
            s->column[k] = times(row_of(s, s->U, k)[i], s->inverse[k]);
        }
        row_of(s, s->data, i)[d] = s->g[i];
        for (; j + STRIP <= vectors; j += STRIP) {
            strip_of_row(s, i, j, STRIP);
        }
        switch (vectors - j) {
        case 7: strip_of_row(s, i, j, 7); break;
        case 6: strip_of_row(s, i, j, 6); break;
        case 5: strip_of_row(s, i, j, 5); break;
        case 4: strip_of_row(s, i, j, 4); break;
        case 3: strip_of_row(s, i, j, 3); break;
        case 2: strip_of_row(s, i, j, 2); break;
        case 1: strip_of_row(s, i, j, 1); break;
        }
        pivot = choose(s->free[i], row[i], constant(1));
        safe = if_less(times(times(constant(SAFE_PIVOT), s->free[i]), s->diagonal[i]), pivot, safe, constant(0));
        s->inverse[i] = divided(constant(1), pivot);
    }
    return safe;
}

/* x from the factor; a variable at a bound stays there to the last bit. */
static void substitute_back(const Pivoting *s)
{
    const int d = s->d;
#ifdef CORE_TILE
    for (int i = d - 1; i >= 0; --i) {
        const num *const row = row_of(s, s->U, i);
        num right = row[d];
        for (int j = d - 1; j > i; --j) {
            right = plus_times(right, row[j], s->x[j]);
        }
        s->x[i] = choose(s->free[i], times(minus(constant(0), right), s->inverse[i]), s->x[i]);
    }
#else
    num *const right = s->column;
    for (int i = 0; i < d; ++i) {
        right[i] = row_of(s, s->U, i)[d];
    }
    for (int j = d - 1; j >= 0; --j) {
        s->x[j] = choose(s->free[j], times(minus(constant(0), right[j]), s->inverse[j]), s->x[j]);
        for (int i = 0; i < j; ++i) {
            right[i] = plus_times(right[i], row_of(s, s->U, i)[j], s->x[j]);
        }
    }
#endif
}

/* Exchange what breaks the conditions; 1 where nothing did and g_F is rounding, and in `broken` 1 where something did. */
static num exchange_sides(const Pivoting *s, num *broken)
{
    const int d = s->d;
    vec8 largest = zeros(), exchanged = zeros(), wrong = zeros(), tolerance;
    for (int i = 0; i < VECTORS(d); ++i) {
        const vec8 scale = vector(s->scale, i), q = mul(scale, vector(s->q, i));
        const vec8 z = mul(mul(scale, vector(s->diagonal, i)), vector(s->x, i));
        largest = larger(larger(magnitude(q), magnitude(z)), largest);
    }
    tolerance = SPREAD(times(constant(4 * (real)d * REAL_EPSILON), largest_entry(largest)));
    for (int i = 0; i < VECTORS(d); ++i) {
        const vec8 side = vector(s->side, i), x = vector(s->x, i), g = mul(vector(s->scale, i), vector(s->g, i));
        const vec8 is_free = vector(s->free, i), left = mul(is_free, magnitude(g)), one = splat(1);
        const vec8 outside = where_less(x, vector(s->lb, i), splat(-1), where_less(vector(s->ub, i), x, one, zeros()));
        const vec8 kept = where_less(tolerance, mul(side, g), zeros(), side);
        const vec8 next = where_less(zeros(), is_free, outside, kept), change = sub(next, side);
        exchanged = where_less(zeros(), mul(change, change), one, exchanged);
        wrong = where_less(mul(splat(RESIDUAL), tolerance), left, one, wrong);
        wrong = where_less(magnitude(x), splat(REAL_INFINITY), wrong, one);
        set_vector(s->side, i, next);
    }
    *broken = largest_entry(exchanged);
    return both(is_not(largest_entry(wrong)), is_not(*broken));
}

num N(pivoting_round)(const Pivoting *s, num *broken)
{
    const int d = s->d;
    num safe, solved;
    for (int i = 0; i < VECTORS(d); ++i) {
        const vec8 side = vector(s->side, i), upper = where_less(zeros(), side, vector(s->ub, i), zeros());
        set_vector(s->x, i, where_less(side, zeros(), vector(s->lb, i), upper));
        set_vector(s->free, i, where_less(zeros(), mul(side, side), zeros(), splat(1)));
    }
    s->free[d] = constant(1);
    gradient(s);
    safe = factorise(s);
    substitute_back(s);
    gradient(s);
    solved = both(safe, exchange_sides(s, broken));
    *broken = both(safe, *broken);
    return solved;
}

#ifdef CORE_TILE
static void move_lane(const num *from, int lane, num *to, int into, int count)
{
    for (int i = 0; i < count; ++i) {
        ((real *)to)[i * LANES + into] = ((const real *)from)[i * LANES + lane];
    }
}

void pivoting_move(const Pivoting *from, int lane, const Pivoting *to, int into)
{
    move_lane(from->data, lane, to->data, into, symmetric_nums(from->d + 1));
    move_lane(from->lb, lane, to->lb, into, from->d);
    move_lane(from->ub, lane, to->ub, into, from->d);
    move_lane(from->side, lane, to->side, into, from->d);
    move_lane(from->scale, lane, to->scale, into, from->d);
    move_lane(from->q, lane, to->q, into, from->d);
    move_lane(from->diagonal, lane, to->diagonal, into, from->d);
}
#endif
