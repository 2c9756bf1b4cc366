/* The exact minimiser over a box by exchanges on P^-1, for a P that is safely positive definite.
 *
 * With F free and A at a bound, M is P swept on F (box_inverse.c) and r holds -x_F and the gradient g_A. Freeing or
 * holding variable j, with p = M_jj and c = -g_j/p or -(bound - x_j)/p, is
 *
 *     r <- r + M_j c  off j,    M <- M - M_j M_j' / p  off row and column j,    M_jj <- -1/p.
 *
 * The exchange that gains most, violation^2/|M_jj|, comes first; from "all free" the number of exchanges is then seldom
 * more than the number of bounds that hold at the optimum. M is not rewritten: column j is made when it is needed, from
 * M = -P^-1 and the columns U of the exchanges before. To that end a variable at a bound is measured in units of its
 * pivot, in which its row stays as it was: M_t = M - sum u u'/p with u_j = 0 (u_j = p - unit where j is freed again),
 * but for the entries M_jj at bounds, which stand in a vector of their own.
 *
 * Whether x is the minimiser is judged after a step of iterative refinement, x_F <- x_F - P_FF^-1 g_F, by g = q + P x
 * itself. The conditions hold to rounding: |g_F| <= (d + 4) eps s/2 and a multiplier not beyond 4 d eps s on its wrong
 * side, with s = max(|q|, |x|), and no bound broken by so much that the exchange would gain more than (eps s)^2, which
 * keeps ties from going back and forth; the answer itself is inside its bounds to the last bit. Where a few steps do
 * not bring that about, box_pivoting.c takes over.
 *
 * Source: R. W. Cottle, "The principal pivoting method of quadratic programming", in Mathematics of the Decision
 * Sciences, AMS, 1968.
 */
#include "box.h"

#include "product.h"

enum { REFINEMENTS = 4 }; /* within which the answer must meet the optimality conditions */

/* What exchanging each of eight variables gains, zero where its sign is right. */
CORE_INLINE vec8 note_gain(const Box *s, int b, vec8 r, vec8 below, vec8 above, vec8 weight)
{
    const vec8 violation = larger(larger(add(below, r), sub(above, r)), zeros());
    const vec8 gain = mul(mul(violation, violation), weight);
    store(s->gain + b, gain);
    return gain;
}

/* All free, at x = -P^-1 q; the largest gain. */
static real start(const Box *s)
{
    vec8 most = zeros();
    affine(s->M, s->ld, s->d, s->q, s->zero, s->x);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 r = sub(zeros(), load(s->x + b)), below = load(s->lo + b), above = sub(zeros(), load(s->hi + b));
        const vec8 weight = load(s->inverse_weight + b);
        store(s->r + b, r);
        store(s->below + b, below);
        store(s->above + b, above);
        store(s->diagonal + b, load(s->inverse_diagonal + b));
        store(s->weight + b, weight);
        store(s->is_free + b, splat(1));
        store(s->at + b, zeros());
        store(s->unit + b, splat(1));
        most = larger(most, note_gain(s, b, r, below, above, weight));
    }
    return largest8(most);
}

/* The variable whose exchange gains so much: of the last block that has one the first. */
static int gaining(const Box *s, real most)
{
    int chosen = 0;
    for (int b = 0; b < s->ld; b += LANES) {
        const int place = first_equal8(load(s->gain + b), most);
        chosen = place < LANES ? b + place : chosen;
    }
    return chosen;
}

/* What an exchange of variable j changes beside column j of M. */
typedef struct {
    int j, count; /* and which exchange it is */
    real c, inverse, r, diagonal, own, below, above;
} Exchange;

CORE_INLINE vec8 finish_block(const Box *s, const Exchange *e, vec8 u, int b)
{
    const int lane = e->j - b;
    const vec8 r = with_lane(plus_product(load(s->r + b), u, splat(e->c)), lane, e->r);
    const vec8 diagonal =
        with_lane(less_product(load(s->diagonal + b), mul(u, splat(e->inverse)), u), lane, e->diagonal);
    const vec8 weight = over(splat(1), magnitude(diagonal));
    const vec8 below = with_lane(load(s->below + b), lane, e->below),
               above = with_lane(load(s->above + b), lane, e->above);
    store(s->r + b, r);
    store(s->diagonal + b, diagonal);
    store(s->weight + b, weight);
    store(s->below + b, below);
    store(s->above + b, above);
    store(s->U + (size_t)e->count * (size_t)s->ld + b, with_lane(u, lane, e->own));
    return note_gain(s, b, r, below, above, weight);
}

/* Up to three blocks of column j of the present M, and what follows from it; their gains, of which the largest counts.
 */
CORE_INLINE vec8 exchange_blocks(const Box *s, const Exchange *e, int b, int blocks)
{
    const size_t ld = (size_t)s->ld;
    const real *const row = s->M + (size_t)e->j * ld;
    vec8 u[3], most = zeros();
    for (int i = 0; i < blocks; ++i) {
        u[i] = load(row + b + 8 * i);
    }
    for (int k = 0; k < e->count; k += 4) { /* the factors from `count` on are zero */
        const real *const before = s->U + (size_t)k * ld;
        const vec8 s0 = splat(before[e->j] * s->factor[k]), s1 = splat(before[ld + (size_t)e->j] * s->factor[k + 1]);
        const vec8 s2 = splat(before[2 * ld + (size_t)e->j] * s->factor[k + 2]);
        const vec8 s3 = splat(before[3 * ld + (size_t)e->j] * s->factor[k + 3]);
        for (int i = 0; i < blocks; ++i) {
            const real *const at = before + b + 8 * i;
            const vec8 even = less_product(less_product(u[i], load(at), s0), load(at + 2 * ld), s2);
            u[i] = sub(even, plus_product(mul(load(at + ld), s1), load(at + 3 * ld), s3));
        }
    }
    for (int i = 0; i < blocks; ++i) {
        most = larger(most, finish_block(s, e, u[i], b + 8 * i));
    }
    return most;
}

/* Bring variable j to a side that it is not on, as exchange number `count`; the largest gain then. */
static real exchange(const Box *s, int j, int side, int count)
{
    const real p = s->diagonal[j], r = s->r[j], lo = s->lo[j], hi = s->hi[j], unit = s->unit[j];
    Exchange e;
    vec8 most = zeros();
    int b = 0;
    e.j = j;
    e.count = count;
    e.inverse = s->weight[j];
    s->side[j] = side;
    if (side == FREE) {
        e.c = -r * e.inverse;
        e.r = -(s->at[j] + e.c * unit);
        e.diagonal = -unit * unit * e.inverse;
        e.own = p - unit;
        e.below = lo;
        e.above = -hi;
        s->at[j] = 0;
        s->is_free[j] = 1;
        s->unit[j] = 1;
    } else {
        const real bound = side == LOWER ? lo : hi;
        e.r = bound + r;
        e.diagonal = -p;
        e.own = 0;
        e.c = e.r * e.inverse;
        e.inverse = -e.inverse;
        e.below = side == LOWER || lo == hi ? -REAL_INFINITY : 0;
        e.above = side == UPPER || lo == hi ? -REAL_INFINITY : 0;
        s->at[j] = bound;
        s->is_free[j] = 0;
        s->unit[j] = -p;
    }
    if (count % 4 == 0) { /* four columns are read at a time */
        memset(s->U + (size_t)count * (size_t)s->ld, 0, 4 * (size_t)s->ld * sizeof(real));
    }
    for (; PRODUCT_BLOCKS > 2 && b + 24 <= s->ld; b += 24) {
        most = larger(most, exchange_blocks(s, &e, b, 3));
    }
    for (; PRODUCT_BLOCKS > 1 && b + 16 <= s->ld; b += 16) {
        most = larger(most, exchange_blocks(s, &e, b, 2));
    }
    for (; b < s->ld; b += 8) {
        most = larger(most, exchange_blocks(s, &e, b, 1));
    }
    s->factor[count] = e.inverse;
    return largest8(most);
}

/* Refine x, renew r from it and g = q + P x; whether g_F is zero to rounding, the largest gain and, in `negligible`,
 * what is none. */
static int refine(const Box *s, int count, real *top, real *negligible)
{
    const int d = s->d, ld = s->ld;
    vec8 longest = zeros(), linear = zeros(), residual = zeros(), total = zeros(), most = zeros();
    real x_size, q_size, rounding, tolerance;
    for (int b = 0; b < ld; b += LANES) {
        store(s->x + b, less_product(load(s->at + b), load(s->is_free + b), load(s->r + b)));
    }
    affine(s->P, ld, d, s->x, s->q, s->g);
    for (int b = 0; b < ld; b += LANES) {
        store(s->masked + b, mul(load(s->g + b), load(s->is_free + b)));
    }
    affine(s->M, ld, d, s->masked, s->zero, s->step);
    for (int k = 0; k < count; ++k) {
        const real *const u = s->U + (size_t)k * (size_t)ld;
        vec8 product = zeros();
        for (int b = 0; b < ld; b += LANES) {
            product = plus_product(product, load(u + b), load(s->masked + b));
        }
        s->share[k] = sum8(product) * s->factor[k];
    }
    for (int b = 0; b < ld; b += LANES) {
        const vec8 q = load(s->q + b);
        vec8 step = load(s->step + b), x;
        for (int k = 0; k < count; ++k) {
            step = less_product(step, load(s->U + (size_t)k * (size_t)ld + b), splat(s->share[k]));
        }
        x = plus_product(load(s->x + b), load(s->is_free + b), step);
        longest = larger(longest, magnitude(x));
        linear = larger(linear, magnitude(q));
        store(s->x + b, x);
    }
    affine(s->P, ld, d, s->x, s->q, s->g);
    x_size = largest8(longest);
    q_size = largest8(linear);
    rounding = REAL_EPSILON * (x_size > q_size ? x_size : q_size);
    tolerance = 4 * (real)d * rounding;
    for (int b = 0; b < ld; b += LANES) {
        const vec8 g = load(s->g + b), free = load(s->is_free + b);
        const vec8 beyond = mul(sub(g, clip(g, splat(-tolerance), splat(tolerance))), load(s->unit + b));
        const vec8 r = sub(mul(sub(splat(1), free), beyond), mul(free, load(s->x + b)));
        residual = larger(magnitude(mul(g, free)), residual);
        total = add(total, g);
        store(s->r + b, r);
        most = larger(most, note_gain(s, b, r, load(s->below + b), load(s->above + b), load(s->weight + b)));
    }
    *top = largest8(most);
    *negligible = rounding * rounding;
    return largest8(residual) <= (real)(d + 4) * rounding / 2 && MAGNITUDE(sum8(total)) < REAL_INFINITY
           && (x_size <= BOX_LARGE * q_size || x_size == 0);
}

static void write_answer(const Box *s)
{
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 x = larger(smaller(load(s->x + b), load(s->hi + b)), load(s->lo + b));
        store(s->answer + b, mul(load(s->scale + b), x));
    }
}

/* Solve from "all free" or, warm, from the sides; OK, CAPPED, or BREAKDOWN where it does not come to an end. */
int box_exchange_all(Box *s, int warm)
{
    const int limit = 2 * s->ld;
    int count = 0, most_exchanges = limit, steps = 0, exact = 0;
    real negligible = 0, top;
    memset(s->factor, 0, (size_t)limit * sizeof(real));
    s->head->factorised = 0; /* the columns of the exchanges take the place of the program of the fallback */
    top = start(s);
    for (int j = 0; j < s->d; ++j) {
        const int side = s->side[j];
        s->side[j] = FREE;
        if (warm && ((side == LOWER && s->lo[j] > -REAL_INFINITY) || (side == UPPER && s->hi[j] < REAL_INFINITY))) {
            top = exchange(s, j, side, count);
            ++count;
        }
    }
    if (s->head->cap > 0 && count + s->head->cap < limit) {
        most_exchanges = count + s->head->cap;
    }
    while (steps == 0 || top > negligible || !exact) {
        while (top > negligible && count < most_exchanges) {
            const int j = gaining(s, top);
            const int side = s->side[j] != FREE ? FREE : s->below[j] + s->r[j] > 0 ? LOWER : UPPER;
            top = exchange(s, j, side, count);
            ++count;
        }
        if (steps == REFINEMENTS || count == limit) {
            return BREAKDOWN;
        }
        exact = refine(s, count, &top, &negligible);
        ++steps;
        if (count == most_exchanges && top > negligible) {
            break;
        }
    }
    s->head->exchanges = count;
    s->head->systems = steps;
    write_answer(s);
    return top > negligible ? CAPPED : OK;
}
