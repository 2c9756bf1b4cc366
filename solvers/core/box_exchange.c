/* The exact minimiser over a box by exchanges on P^-1, for a P that is safely positive definite.
 *
 * Of each variable j one of x_j and its gradient g_j is given and the other is basic: with F free and A at a bound, g_F
 * = 0 and x_A are given, and `basic` holds -x_F and g_A. It is right in an interval [low, high]: -x_j in [-hi, -lo],
 * g_j in [0, inf) at a lower bound, in (-inf, 0] at an upper one, anywhere where both are the same.
 *
 * With W the matrix P swept on F (box_inverse.c), p = W_jj and t the change of the given x_j or g_j, an exchange of
 * variable j, which frees it or takes it to a bound, is
 *
 *     basic <- basic + t W_j  off j,    W <- W - W_j W_j'/p  off row and column j,    W_j <- W_j/|p|,    W_jj <- -1/p.
 *
 * The one that gains most, violation^2/|W_jj|, comes first; from "all free" the number of exchanges is then seldom more
 * than the number of bounds that hold at the optimum. W is not rewritten: its column j is made when it is needed, from
 * M = -P^-1 and the columns U of the exchanges before. To that end a variable at a bound is measured in a unit, the |p|
 * with which it got there, in which its row and column stay as they were: the one column u of an exchange then says it
 * all,
 *
 *     W = M - sum over the exchanges of u u'/p,    u = W_j  but for  u_j = 0, or p - unit where j is freed again,
 *
 * except for the diagonal, which stands in a vector of its own.
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

/* How far the search is. */
typedef struct {
    int count;       /* exchanges, the columns of U */
    real most;       /* the largest gain of one more */
    real negligible; /* a gain that is none */
} Search;

/* Keep and return what exchanging each of eight variables gains, zero where it is in its interval. */
CORE_INLINE vec8 keep_gains(const Box *s, int b, vec8 basic, vec8 weight)
{
    const vec8 above = sub(basic, load(s->high + b)), below = sub(load(s->low + b), basic);
    const vec8 violation = larger(larger(above, below), zeros()), gain = mul(mul(violation, violation), weight);
    store(s->gain + b, gain);
    return gain;
}

/* All free, at x = -P^-1 q. */
static void free_all(const Box *s, Search *search)
{
    vec8 most = zeros();
    affine(s->M, s->ld, s->d, s->q, s->zero, s->x);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 basic = sub(zeros(), load(s->x + b)), diagonal = load(s->inverse_diagonal + b);
        const vec8 weight = divide(splat(1), magnitude(diagonal));
        store(s->basic + b, basic);
        store(s->low + b, sub(zeros(), load(s->hi + b)));
        store(s->high + b, sub(zeros(), load(s->lo + b)));
        store(s->diagonal + b, diagonal);
        store(s->weight + b, weight);
        store(s->is_free + b, splat(1));
        store(s->held + b, zeros());
        store(s->unit + b, splat(1));
        most = larger(most, keep_gains(s, b, basic, weight));
    }
    search->most = largest8(most);
    search->count = 0;
}

/* The variable whose exchange gains most: of the last block that has one the first. */
static int most_gaining(const Box *s, real most)
{
    int chosen = 0;
    for (int b = 0; b < s->ld; b += LANES) {
        const int place = first_equal8(load(s->gain + b), most);
        chosen = place < LANES ? b + place : chosen;
    }
    return chosen;
}

/* An exchange of variable j. */
typedef struct {
    int j;
    real step, inverse;          /* t and 1/p */
    real basic, diagonal, entry; /* of j afterwards, and u_j */
} Exchange;

/* Take a free variable to a bound. */
static Exchange hold(const Box *s, int j, int side)
{
    const real p = s->diagonal[j], weight = s->weight[j], lo = s->lo[j], hi = s->hi[j];
    const real bound = side == LOWER ? lo : hi, way = bound + s->basic[j];
    const Exchange e = {j, way * weight, -weight, way, -p, 0};
    s->side[j] = side;
    s->held[j] = bound;
    s->is_free[j] = 0;
    s->unit[j] = -p;
    s->low[j] = side == LOWER && lo < hi ? 0 : -REAL_INFINITY;
    s->high[j] = side == UPPER && lo < hi ? 0 : REAL_INFINITY;
    return e;
}

/* Free a variable that is at a bound. */
static Exchange release(const Box *s, int j)
{
    const real p = s->diagonal[j], weight = s->weight[j], unit = s->unit[j], step = -s->basic[j] * weight;
    const Exchange e = {j, step, weight, -(s->held[j] + step * unit), -unit * unit * weight, p - unit};
    s->side[j] = FREE;
    s->held[j] = 0;
    s->is_free[j] = 1;
    s->unit[j] = 1;
    s->low[j] = -s->hi[j];
    s->high[j] = -s->lo[j];
    return e;
}

/* Up to three blocks from b on of column j of W, and what follows from it; their gains, of which the largest counts. */
CORE_INLINE vec8 exchange_blocks(const Box *s, const Exchange *e, int count, int b, int blocks)
{
    const size_t ld = (size_t)s->ld;
    const real *const row = s->M + (size_t)e->j * ld;
    vec8 w[PRODUCT_BLOCKS], most = zeros();
    for (int i = 0; i < blocks; ++i) {
        w[i] = load(row + b + LANES * i);
    }
    for (int k = 0; k < count; k += 4) { /* the factors from `count` on are zero */
        const real *const U = s->U + (size_t)k * ld, *const at_j = U + e->j, *const factor = s->factor + k;
        const vec8 s0 = splat(at_j[0] * factor[0]), s1 = splat(at_j[ld] * factor[1]);
        const vec8 s2 = splat(at_j[2 * ld] * factor[2]), s3 = splat(at_j[3 * ld] * factor[3]);
        for (int i = 0; i < blocks; ++i) {
            const real *const u = U + b + LANES * i;
            const vec8 even = sub_mul(sub_mul(w[i], load(u), s0), load(u + 2 * ld), s2);
            w[i] = sub(even, plus_product(mul(load(u + ld), s1), load(u + 3 * ld), s3));
        }
    }
    for (int i = 0; i < blocks; ++i, b += LANES) {
        const int lane = e->j - b;
        const vec8 basic = with_lane(plus_product(load(s->basic + b), w[i], splat(e->step)), lane, e->basic);
        const vec8 square = mul(mul(w[i], splat(e->inverse)), w[i]);
        const vec8 diagonal = with_lane(sub(load(s->diagonal + b), square), lane, e->diagonal);
        const vec8 weight = divide(splat(1), magnitude(diagonal));
        store(s->basic + b, basic);
        store(s->diagonal + b, diagonal);
        store(s->weight + b, weight);
        store(s->U + (size_t)count * ld + b, with_lane(w[i], lane, e->entry));
        most = larger(most, keep_gains(s, b, basic, weight));
    }
    return most;
}

/* Bring variable j to a side that it is not on. */
static void exchange(const Box *s, Search *search, int j, int side)
{
    const Exchange e = side == FREE ? release(s, j) : hold(s, j, side);
    const int count = search->count;
    vec8 most = zeros();
    int b = 0;
    if (count % 4 == 0) { /* four columns are read at a time */
        memset(s->U + (size_t)count * (size_t)s->ld, 0, 4 * (size_t)s->ld * sizeof(real));
        memset(s->factor + count, 0, 4 * sizeof(real));
    }
    for (; b + LANES * PRODUCT_BLOCKS <= s->ld; b += LANES * PRODUCT_BLOCKS) {
        most = larger(most, exchange_blocks(s, &e, count, b, PRODUCT_BLOCKS));
    }
    for (; PRODUCT_BLOCKS > 1 && b < s->ld; b += LANES) {
        most = larger(most, exchange_blocks(s, &e, count, b, 1));
    }
    s->factor[count] = e.inverse;
    search->count = count + 1;
    search->most = largest8(most);
}

/* x_F <- x_F - P_FF^-1 g_F, which is W_FF g_F. */
static void newton_step(const Box *s, int count)
{
    const int ld = s->ld;
    for (int b = 0; b < ld; b += LANES) {
        store(s->residual + b, mul(load(s->g + b), load(s->is_free + b)));
    }
    affine(s->M, ld, s->d, s->residual, s->zero, s->step);
    for (int k = 0; k < count; ++k) {
        const real *const u = s->U + (size_t)k * (size_t)ld;
        vec8 product = zeros();
        for (int b = 0; b < ld; b += LANES) {
            product = plus_product(product, load(u + b), load(s->residual + b));
        }
        s->share[k] = sum8(product) * s->factor[k];
    }
    for (int b = 0; b < ld; b += LANES) {
        vec8 step = load(s->step + b);
        for (int k = 0; k < count; ++k) {
            step = sub_mul(step, load(s->U + (size_t)k * (size_t)ld + b), splat(s->share[k]));
        }
        store(s->x + b, plus_product(load(s->x + b), load(s->is_free + b), step));
    }
}

/* Refine x, renew g and `basic` from it and the gains from these; whether g_F is zero to rounding. */
static int refine(const Box *s, Search *search)
{
    const int d = s->d, ld = s->ld;
    vec8 longest = zeros(), linear = zeros(), residual = zeros(), total = zeros(), most = zeros();
    real x_size, q_size, rounding;
    vec8 tolerance;
    for (int b = 0; b < ld; b += LANES) {
        store(s->x + b, sub_mul(load(s->held + b), load(s->is_free + b), load(s->basic + b)));
    }
    affine(s->P, ld, d, s->x, s->q, s->g);
    newton_step(s, search->count);
    affine(s->P, ld, d, s->x, s->q, s->g);
    for (int b = 0; b < ld; b += LANES) {
        longest = larger(longest, magnitude(load(s->x + b)));
        linear = larger(linear, magnitude(load(s->q + b)));
    }
    x_size = largest8(longest);
    q_size = largest8(linear);
    rounding = REAL_EPSILON * (x_size > q_size ? x_size : q_size);
    tolerance = splat(4 * (real)d * rounding);
    for (int b = 0; b < ld; b += LANES) {
        const vec8 g = load(s->g + b), free = load(s->is_free + b);
        const vec8 beyond = mul(sub(g, clip(g, sub(zeros(), tolerance), tolerance)), load(s->unit + b));
        const vec8 basic = sub(mul(sub(splat(1), free), beyond), mul(free, load(s->x + b)));
        residual = larger(magnitude(mul(g, free)), residual);
        total = add(total, g);
        store(s->basic + b, basic);
        most = larger(most, keep_gains(s, b, basic, load(s->weight + b)));
    }
    search->most = largest8(most);
    search->negligible = rounding * rounding;
    return largest8(residual) <= (real)(d + 4) * rounding / 2 && MAGNITUDE(sum8(total)) < REAL_INFINITY
           && (x_size <= BOX_LARGE * q_size || x_size == 0);
}

/* The sides of the last solve, or none but what has no bound there. */
static void hold_sides(const Box *s, Search *search, int warm)
{
    for (int j = 0; j < s->d; ++j) {
        const int side = s->side[j];
        s->side[j] = FREE;
        if (warm && ((side == LOWER && s->lo[j] > -REAL_INFINITY) || (side == UPPER && s->hi[j] < REAL_INFINITY))) {
            exchange(s, search, j, side);
        }
    }
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
    const int room = 2 * s->ld;
    int limit = room, steps = 0, exact = 0;
    Search search = {0, 0, 0};
    s->head->factorised = 0; /* the columns of the exchanges take the place of the program of the fallback */
    free_all(s, &search);
    hold_sides(s, &search, warm);
    if (s->head->cap > 0 && search.count + s->head->cap < room) {
        limit = search.count + s->head->cap;
    }
    do {
        while (search.most > search.negligible && search.count < limit) {
            const int j = most_gaining(s, search.most);
            exchange(s, &search, j, s->side[j] != FREE ? FREE : s->basic[j] > s->high[j] ? LOWER : UPPER);
        }
        if (steps == REFINEMENTS || search.count == room) {
            return BREAKDOWN;
        }
        exact = refine(s, &search);
        ++steps;
    } while (search.most > search.negligible ? search.count < limit : !exact);
    s->head->exchanges = search.count;
    s->head->systems = steps;
    write_answer(s);
    return search.most > search.negligible ? CAPPED : OK;
}
