/* Block principal pivoting in eight lanes.
 *
 * A guess of which variables F are free and which A sit at a bound leaves one candidate, x_A at its bounds and
 *
 *     P_FF x_F = -(q_F + P_FA x_A).
 *
 * It is the minimiser iff lb <= x_F <= ub and the gradient g = q + P x holds every bound: g >= 0 at a lower, g <= 0 at an upper one. Each
 * round exchanges all variables that break this (Judice & Pires, Computers & Operations Research 21 (1994) 587). The lanes differ in F
 * and share every instruction: the system is solved at full size, with the rows and columns of A replaced by those of the identity,
 *
 *     ( P_FF  0 ) ( x_F )     ( -(q_F + P_FA x_A) )
 *     (  0    I ) ( x_A )  =  (        x_A        ),
 *
 * as U'D^-1 U row by row, the right-hand side being one column more. A lane that is done repeats its last round to the last bit, so what
 * the other lanes do changes nothing in it.
 *
 * Tolerances are in the variables z = x / S with S P S of unit diagonal up to a factor of two: the rounding of S g is about d eps max(|z|, |S q|).
 * A multiplier within it counts as zero, which keeps ties from cycling; a bound has no tolerance. A lane is solved when no condition is
 * broken and S g_F is rounding. Pivoting may cycle, and has no safe pivots where P is near singular: such a lane is left unsolved.
 */
#include "box_lanes.h"

enum { STRIP = PARTS == 1 ? 8 : PARTS == 2 ? 4 : 2 }; /* columns of the factor that stay in registers */
#define SAFE_PIVOT ((real)1e-13)     /* least share of the diagonal of P that a pivot has */
#define RESIDUAL ((real)64)          /* times the rounding of g: so much of g_F may be left */
#define SMALLEST ((real)1e-30)       /* diagonal below which a lane is left */

CORE_INLINE real *row8(const BoxLanes *s, real *matrix, int i) { return lane8(matrix, triangle_row(s->d + 1, i)); }
/* Write S; 1 where the diagonal is positive and finite. */
static vec8 take_scale(const BoxLanes *s)
{
    vec8 fine = splat(1);
    for (int i = 0; i < s->d; ++i) {
        const vec8 diagonal = load(row8(s, s->data, i) + i * LANES);
        store(lane8(s->scale, i), root_scale(diagonal));
        fine = where_less(splat(SMALLEST), diagonal, where_less(diagonal, splat(REAL_INFINITY), fine, zeros()), zeros());
    }
    return fine;
}

/* g = q + P x, two rows at a time. */
static void gradient(const BoxLanes *s)
{
    const int d = s->d;
    real *const at = s->x, *const g = s->g;
    int i = 0;
    for (int j = 0; j < d; ++j) {
        store(lane8(g, j), load(row8(s, s->data, j) + d * LANES));
    }
    for (; i + 1 < d; i += 2) {
        const real *const row = row8(s, s->data, i), *const next = row8(s, s->data, i + 1);
        const vec8 x = load(lane8(at, i)), x_next = load(lane8(at, i + 1)), beside = load(row + (i + 1) * LANES);
        vec8 sum = plus_product(plus_product(load(lane8(g, i)), load(row + i * LANES), x), beside, x_next);
        vec8 sum_next = plus_product(plus_product(load(lane8(g, i + 1)), beside, x), load(next + (i + 1) * LANES), x_next);
        for (int j = i + 2; j < d; ++j) {
            const vec8 entry = load(row + j * LANES), entry_next = load(next + j * LANES), x_j = load(lane8(at, j));
            sum = plus_product(sum, entry, x_j);
            sum_next = plus_product(sum_next, entry_next, x_j);
            store(lane8(g, j), plus_product(plus_product(load(lane8(g, j)), entry, x), entry_next, x_next));
        }
        store(lane8(g, i), sum);
        store(lane8(g, i + 1), sum_next);
    }
    if (i < d) {
        store(lane8(g, i), plus_product(load(lane8(g, i)), load(row8(s, s->data, i) + i * LANES), load(lane8(at, i))));
    }
}

/* So many columns from j on of row i of the factor: U_ij = P_ij - sum over k < i of (U_ki / D_k) U_kj, zero where i or j is at a bound. */
CORE_INLINE void strip_of_row(const BoxLanes *s, int i, int j, int columns)
{
    const real *const source = row8(s, s->data, i) + j * LANES, *above = s->U + j * LANES;
    real *const to = row8(s, s->U, i) + j * LANES;
    const vec8 is_free = load(lane8(s->free, i));
    vec8 sum[LANES];
    for (int c = 0; c < columns; ++c) {
        sum[c] = load(source + c * LANES);
    }
    for (int k = 0; k < i; ++k, above += (s->d - k + 1) * LANES) {
        const vec8 share = load(lane8(s->column, k));
        for (int c = 0; c < columns; ++c) {
            sum[c] = less_product(sum[c], share, load(above + c * LANES));
        }
    }
    for (int c = 0; c < columns; ++c) {
        store(to + c * LANES, mul(mul(is_free, load(lane8(s->free, j + c))), sum[c]));
    }
}

/* Factorise with the sides as they are, x_A at its bounds and g there for x_F = 0; 1 where every pivot was safe. */
static vec8 factorise(const BoxLanes *s)
{
    const int d = s->d;
    real *const inverse = s->inverse, *const column = s->column;
    vec8 safe = splat(1);
    for (int i = 0; i < d; ++i) {
        real *const row = row8(s, s->U, i);
        const real *above = s->U;
        const vec8 is_free = load(lane8(s->free, i)), diagonal = load(row8(s, s->data, i) + i * LANES);
        vec8 right = load(lane8(s->g, i)), pivot = diagonal;
        int j = i + 1;
        for (int k = 0; k < i; ++k, above += (d - k + 1) * LANES) {
            const vec8 entry = load(above + i * LANES), share = mul(entry, load(lane8(inverse, k)));
            store(lane8(column, k), share);
            pivot = less_product(pivot, share, entry);
            right = less_product(right, share, load(above + d * LANES));
        }
        store(row + d * LANES, right);
        /* The division first, since every row waits for the one before. */
        safe = where_less(mul(mul(splat(SAFE_PIVOT), is_free), diagonal), pivot, safe, zeros());
        store(lane8(inverse, i), over(splat(1), where_less(zeros(), is_free, pivot, splat(1))));
        for (; j + STRIP <= d; j += STRIP) {
            strip_of_row(s, i, j, STRIP);
        }
        switch (d - j) {
        case 7: strip_of_row(s, i, j, 7); break;
        case 6: strip_of_row(s, i, j, 6); break;
        case 5: strip_of_row(s, i, j, 5); break;
        case 4: strip_of_row(s, i, j, 4); break;
        case 3: strip_of_row(s, i, j, 3); break;
        case 2: strip_of_row(s, i, j, 2); break;
        case 1: strip_of_row(s, i, j, 1); break;
        }
    }
    return safe;
}

/* x from the factor; a variable at a bound stays there to the last bit. */
static void substitute_back(const BoxLanes *s)
{
    const int d = s->d;
    for (int i = d - 1; i >= 0; --i) {
        const real *const row = row8(s, s->U, i);
        vec8 right = load(row + d * LANES);
        for (int j = d - 1; j > i; --j) {
            right = plus_product(right, load(row + j * LANES), load(lane8(s->x, j)));
        }
        right = mul(sub(zeros(), right), load(lane8(s->inverse, i)));
        store(lane8(s->x, i), where_less(zeros(), load(lane8(s->free, i)), right, load(lane8(s->x, i))));
    }
}

/* Exchange what breaks the conditions; 1 where nothing did and g_F is rounding, and in `broken` 1 where something did. */
static vec8 exchange(const BoxLanes *s, vec8 *broken)
{
    const int d = s->d;
    vec8 largest = zeros(), tolerance, solved = splat(1);
    *broken = zeros();
    for (int i = 0; i < d; ++i) {
        const vec8 scale = load(lane8(s->scale, i)), q = mul(scale, load(row8(s, s->data, i) + d * LANES));
        const vec8 z = mul(mul(scale, load(row8(s, s->data, i) + i * LANES)), load(lane8(s->x, i)));
        largest = larger(larger(magnitude(q), magnitude(z)), largest);
    }
    tolerance = mul(splat(4 * (real)d * REAL_EPSILON), largest);
    for (int i = 0; i < d; ++i) {
        const vec8 side = load(lane8(s->side, i)), x = load(lane8(s->x, i)), g = mul(load(lane8(s->scale, i)), load(lane8(s->g, i)));
        const vec8 is_free = load(lane8(s->free, i)), left = mul(is_free, magnitude(g));
        const vec8 outside = where_less(x, load(lane8(s->lb, i)), splat(-1), where_less(load(lane8(s->ub, i)), x, splat(1), zeros()));
        const vec8 kept = where_less(tolerance, mul(side, g), zeros(), side);
        const vec8 next = where_less(zeros(), is_free, outside, kept), change = sub(next, side);
        *broken = where_less(zeros(), mul(change, change), splat(1), *broken);
        solved = where_less(mul(splat(RESIDUAL), tolerance), left, zeros(), solved);
        solved = where_less(magnitude(x), splat(REAL_INFINITY), solved, zeros());
        store(lane8(s->side, i), next);
    }
    return mul(solved, sub(splat(1), *broken));
}

vec8 box_lanes_round(const BoxLanes *s, vec8 *broken)
{
    const vec8 fine = take_scale(s);
    vec8 safe, solved;
    for (int i = 0; i < s->d; ++i) {
        const vec8 side = load(lane8(s->side, i)), upper = where_less(zeros(), side, load(lane8(s->ub, i)), zeros());
        store(lane8(s->x, i), where_less(side, zeros(), load(lane8(s->lb, i)), upper));
        store(lane8(s->free, i), where_less(zeros(), mul(side, side), zeros(), splat(1)));
    }
    gradient(s);
    safe = mul(fine, factorise(s));
    substitute_back(s);
    gradient(s);
    solved = mul(safe, exchange(s, broken));
    *broken = mul(safe, *broken);
    return solved;
}

void box_lanes_move(const BoxLanes *from, int lane, const BoxLanes *to, int into)
{
    const int entries = triangle(from->d + 1);
    for (int i = 0; i < entries; ++i) {
        to->data[i * LANES + into] = from->data[i * LANES + lane];
    }
    for (int i = 0; i < from->d; ++i) {
        to->lb[i * LANES + into] = from->lb[i * LANES + lane];
        to->ub[i * LANES + into] = from->ub[i * LANES + lane];
        to->side[i * LANES + into] = from->side[i * LANES + lane];
    }
}
