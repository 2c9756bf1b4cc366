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

enum { STRIP = PARTS == 1 ? BOX_STRIP : BOX_STRIP / 3 }; /* columns of the factor that stay in registers */
#define SAFE_PIVOT ((real)1e-13)     /* least share of the diagonal of P that a pivot has */
#define RESIDUAL ((real)64)          /* times the rounding of g: so much of g_F may be left */
#define SMALLEST ((real)1e-30)       /* diagonal below which a lane is left */

CORE_INLINE real *row8(const BoxLanes *s, real *matrix, int i) { return lane8(matrix, triangle_row(s->d + 1, i)); }
/* 1 where a variable is free, else 0. */
CORE_INLINE vec8 freedom(const BoxLanes *s, int i)
{
    const vec8 side = load(lane8(s->side, i));
    return where_less(zeros(), mul(side, side), zeros(), splat(1));
}

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

static void gradient(const BoxLanes *s)
{
    const int d = s->d;
    for (int i = 0; i < d; ++i) {
        store(lane8(s->g, i), load(row8(s, s->data, i) + d * LANES));
    }
    for (int i = 0; i < d; ++i) {
        const real *const row = row8(s, s->data, i);
        const vec8 x = load(lane8(s->x, i));
        vec8 even = plus_product(load(lane8(s->g, i)), load(row + i * LANES), x), odd = zeros(); /* so that no sum waits for the one before */
        int j = i + 1;
        for (; j + 1 < d; j += 2) {
            const vec8 entry = load(row + j * LANES), next = load(row + (j + 1) * LANES);
            odd = plus_product(odd, entry, load(lane8(s->x, j)));
            even = plus_product(even, next, load(lane8(s->x, j + 1)));
            store(lane8(s->g, j), plus_product(load(lane8(s->g, j)), entry, x));
            store(lane8(s->g, j + 1), plus_product(load(lane8(s->g, j + 1)), next, x));
        }
        if (j < d) {
            const vec8 entry = load(row + j * LANES);
            odd = plus_product(odd, entry, load(lane8(s->x, j)));
            store(lane8(s->g, j), plus_product(load(lane8(s->g, j)), entry, x));
        }
        store(lane8(s->g, i), add(even, odd));
    }
}

/* A strip of columns from j on of row i of the factor: U_ij = A_ij - sum over k < i of (U_ki / D_k) U_kj. What is beyond the row's end
 * belongs to the row below, which is not there yet. */
static void strip_of_row(const BoxLanes *s, int i, int j)
{
    real *const to = row8(s, s->U, i) + j * LANES;
    vec8 sum[STRIP];
    for (int c = 0; c < STRIP; ++c) {
        sum[c] = load(to + c * LANES);
    }
    for (int k = 0; k < i; ++k) {
        const real *const above = row8(s, s->U, k) + j * LANES;
        const vec8 share = load(lane8(s->column, k));
        for (int c = 0; c < STRIP; ++c) {
            sum[c] = less_product(sum[c], share, load(above + c * LANES));
        }
    }
    for (int c = 0; c < STRIP; ++c) {
        store(to + c * LANES, sum[c]);
    }
}

/* Factorise with the sides as they are, x_A at its bounds and g there for x_F = 0; 1 where every pivot was safe. */
static vec8 factorise(const BoxLanes *s)
{
    const int d = s->d;
    vec8 safe = splat(1);
    for (int i = 0; i < d; ++i) {
        real *const row = row8(s, s->U, i);
        const real *const source = row8(s, s->data, i);
        const vec8 is_free = freedom(s, i), held = sub(splat(1), is_free), diagonal = load(source + i * LANES);
        vec8 pivot;
        store(row + i * LANES, plus_product(held, is_free, diagonal));
        for (int c = i + 1; c < d; ++c) {
            store(row + c * LANES, mul(mul(is_free, freedom(s, c)), load(source + c * LANES)));
        }
        store(row + d * LANES, where_less(zeros(), is_free, sub(zeros(), load(lane8(s->g, i))), load(lane8(s->x, i))));
        for (int k = 0; k < i; ++k) {
            store(lane8(s->column, k), mul(load(row8(s, s->U, k) + i * LANES), load(lane8(s->inverse, k))));
        }
        for (int j = i; j <= d; j += STRIP) {
            strip_of_row(s, i, j);
        }
        pivot = load(row + i * LANES);
        safe = where_less(mul(mul(splat(SAFE_PIVOT), is_free), diagonal), pivot, safe, zeros());
        store(lane8(s->inverse, i), over(splat(1), pivot));
    }
    return safe;
}

/* x from the factor; a variable at a bound stays there to the last bit. */
static void substitute_back(const BoxLanes *s)
{
    const int d = s->d;
    for (int j = d - 1; j >= 0; --j) {
        const vec8 found = mul(load(row8(s, s->U, j) + d * LANES), load(lane8(s->inverse, j)));
        const vec8 x = where_less(zeros(), freedom(s, j), found, load(lane8(s->x, j)));
        store(lane8(s->x, j), x);
        for (int i = 0; i < j; ++i) {
            real *const row = row8(s, s->U, i);
            store(row + d * LANES, less_product(load(row + d * LANES), load(row + j * LANES), x));
        }
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
        const vec8 is_free = freedom(s, i), left = mul(is_free, magnitude(g));
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

int box_lanes_solve(const BoxLanes *s)
{
    const vec8 fine = take_scale(s);
    int rounds = 0;
    vec8 broken, solved;
    do {
        vec8 safe;
        for (int i = 0; i < s->d; ++i) {
            const vec8 side = load(lane8(s->side, i)), upper = where_less(zeros(), side, load(lane8(s->ub, i)), zeros());
            store(lane8(s->x, i), where_less(side, zeros(), load(lane8(s->lb, i)), upper));
        }
        gradient(s);
        safe = mul(fine, factorise(s));
        substitute_back(s);
        gradient(s);
        solved = mul(safe, exchange(s, &broken));
        broken = mul(safe, broken);
        ++rounds;
    } while (sum8(broken) > 0 && rounds < BOX_ROUNDS);
    store(s->solved, solved);
    return rounds;
}
