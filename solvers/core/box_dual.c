/* The dual active set method on P^-1, for bounds.
 *
 * For each variable j one of x_j and its gradient g_j is given and the other is basic: with F free and A at a bound,
 * g_F = 0 and x_A are given, and `basic` holds -x_F and g_A. It is feasible in an interval [low, high]: -x_j in
 * [-hi, -lo], g_j in [0, inf) at a lower bound, in (-inf, 0] at an upper one, anywhere if both bounds are equal.
 *
 * Initially A is empty, so every g_A is feasible. The free variables that violate a bound are moved to it one by one,
 *
 *     choose j in F      with the largest gain, violation^2/|W_jj|
 *     hold j             A <- A + j; done if every multiplier g_A is feasible
 *     release i in A     whose multiplier vanishes first on the segment from the previous multipliers to g_A;
 *                        A <- A - i, repeated until g_A is feasible
 *
 * until no bound is violated. The dual objective rises with each j, so no set returns. The first d exchanges are
 * greedy: the variable with the largest gain, whether it violates its bound or has an infeasible multiplier, is
 * exchanged. From "all free" that mostly ends at the optimum after hardly more exchanges than bounds are active there,
 * while keeping every multiplier feasible takes up to half as many again; if it does not end, all infeasible variables
 * are freed first.
 *
 * With W the matrix P swept on F (box_inverse.c), p = W_jj and t the change of the given x_j or g_j, an exchange of
 * variable j is
 *
 *     basic <- basic + t W_j  off j,    W <- W - W_j W_j'/p  off row and column j,    W_j <- W_j/|p|,    W_jj <- -1/p.
 *
 * W is not stored: its column j is computed when needed, from M = -P^-1 and the columns U of the previous exchanges. To
 * that end a multiplier is measured in units of the |p| with which its variable was moved to the bound, so that its row
 * and column do not change. Then one column u describes an exchange,
 *
 *     W = M - sum over the exchanges of u u'/p,    u = W_j  but for  u_j = 0, or p - unit if j is freed again,
 *
 * except for the diagonal, which is stored in a separate vector.
 *
 * Whether x is the minimiser is judged after a step of iterative refinement, x_F <- x_F - P_FF^-1 g_F, by g = q + P x
 * itself. The conditions hold to rounding: |g_F| <= (d + 4) eps s/2 and no multiplier beyond 4 d eps s on its wrong
 * side, with s = max(|q|, |x|), and no bound violated so far that an exchange would gain more than (eps s)^2; the
 * answer itself is inside its bounds to the last bit.
 *
 * Source: D. Goldfarb, A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
 * Math. Programming 27 (1983) 1; R. W. Cottle, "The principal pivoting method of quadratic programming", in Mathematics
 * of the Decision Sciences, AMS, 1968 (the exchange).
 */
#include "box.h"

#include "product.h"

enum { RENEWED_AFTER = 4 }; /* columns of U after which W is recomputed if it may be large */
enum { MOST_ROUNDS = 12 };  /* limit of rounds of exchanges and a refinement */
/* Smallest |x|/|q| for which g needs twice the precision: otherwise an error of d eps^2 (|x|/|q|)^2 remains. */
#define LARGE ((real)1e7)

#ifdef CORE_FLOAT
#define SPLITTER 4097.0F
#else
#define SPLITTER 134217729.0
#endif

/* Store the gains of an exchange of eight variables; zero for one in its interval. */
CORE_INLINE void keep_gains(const Box *s, int b, vec8 basic, vec8 weight, vec8 *broken, vec8 *wrong)
{
    const vec8 above = sub(basic, load(s->high + b)), below = sub(load(s->low + b), basic);
    const vec8 violation = maximum(maximum(above, below), zeros()), gain = mul(mul(violation, violation), weight);
    const vec8 of_free = mul(gain, load(s->is_free + b));
    store(s->gain + b, gain);
    *broken = maximum(*broken, of_free);
    *wrong = maximum(*wrong, sub(gain, of_free));
}

/* The largest entry of a vector. */
CORE_INLINE real largest(const real *a, int ld)
{
    vec8 most = zeros();
    for (int b = 0; b < ld; b += LANES) {
        most = maximum(most, magnitude(load(a + b)));
    }
    return largest8(most);
}

/* The size of rounding errors at x; whether x is so large that g needs twice the precision. */
static int measure_rounding(const Box *s, Search *search)
{
    const real x = largest(s->x, s->ld), q = largest(search->linear, s->ld);
    search->rounding = REAL_EPSILON * (x > q ? x : q);
    search->negligible = search->rounding * search->rounding;
    search->tolerated = s->head->singular ? 0 : search->negligible;
    return q > 0 && x > LARGE * q;
}

/* All free, at x = -P^-1 q. */
static void free_all(const Box *s, Search *search)
{
    vec8 broken = zeros(), wrong = zeros();
    affine(s->M, s->ld, s->d, search->linear, s->zero, s->x);
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
        keep_gains(s, b, basic, weight, &broken, &wrong);
    }
    search->broken = largest8(broken);
    search->wrong = 0;
    search->count = 0;
    measure_rounding(s, search);
}

/* The variable with this gain: the first in the last block that has one. */
static int with_gain(const Box *s, real gain)
{
    int chosen = 0;
    for (int b = 0; b < s->ld; b += LANES) {
        const int place = first_equal8(load(s->gain + b), gain);
        chosen = place < LANES ? b + place : chosen;
    }
    return chosen;
}

/* Set the feasible interval of a variable on its side, with this tolerance on a multiplier. */
CORE_INLINE void set_interval(const Box *s, int j, real slack)
{
    const int side = s->side[j], is_fixed = s->lo[j] == s->hi[j];
    s->low[j] = side == FREE ? -s->hi[j] : side == LOWER && !is_fixed ? -slack * s->unit[j] : -REAL_INFINITY;
    s->high[j] = side == FREE ? -s->lo[j] : side == UPPER && !is_fixed ? slack * s->unit[j] : REAL_INFINITY;
}

/* An exchange of variable j. */
typedef struct {
    int j;
    real step, inverse;          /* t and 1/p */
    real basic, diagonal, entry; /* of j afterwards, and u_j */
} Exchange;

/* Move a free variable to a bound. */
static Exchange hold(const Box *s, int j, int side, real slack)
{
    const real p = s->diagonal[j], weight = s->weight[j];
    const real bound = side == LOWER ? s->lo[j] : s->hi[j], way = bound + s->basic[j];
    const Exchange e = {j, way * weight, -weight, way, -p, 0};
    s->side[j] = side;
    s->held[j] = bound;
    s->is_free[j] = 0;
    s->unit[j] = -p;
    set_interval(s, j, slack);
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
    set_interval(s, j, 0);
    return e;
}

/* Up to three blocks of column j of W, from b on, and the update of all quantities that depend on it. */
CORE_INLINE void exchange_blocks(const Box *s, const Exchange *e, int count, int b, int blocks, vec8 *broken,
                                 vec8 *wrong)
{
    const size_t ld = (size_t)s->ld;
    const real *const row = s->M + (size_t)e->j * ld;
    vec8 w[PRODUCT_BLOCKS];
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
        keep_gains(s, b, basic, weight, broken, wrong);
    }
}

/* Move variable j to another side. */
static void exchange(const Box *s, Search *search, int j, int side)
{
    const Exchange e = side == FREE ? release(s, j) : hold(s, j, side, search->slack);
    const int count = search->count;
    vec8 broken = zeros(), wrong = zeros();
    int b = 0;
    if (count % 4 == 0) { /* four columns are read at a time */
        memset(s->U + (size_t)count * (size_t)s->ld, 0, 4 * (size_t)s->ld * sizeof(real));
        memset(s->factor + count, 0, 4 * sizeof(real));
    }
    for (; b + LANES * PRODUCT_BLOCKS <= s->ld; b += LANES * PRODUCT_BLOCKS) {
        exchange_blocks(s, &e, count, b, PRODUCT_BLOCKS, &broken, &wrong);
    }
    for (; PRODUCT_BLOCKS > 1 && b < s->ld; b += LANES) {
        exchange_blocks(s, &e, count, b, 1, &broken, &wrong);
    }
    s->factor[count] = e.inverse;
    search->count = count + 1;
    ++search->exchanges;
    search->broken = largest8(broken);
    search->wrong = largest8(wrong);
}

void box_begin(const Box *s, Search *search, int warm)
{
    const int exchanges = search->exchanges;
    free_all(s, search);
    for (int j = 0; j < s->d; ++j) {
        const int side = s->side[j];
        s->side[j] = FREE;
        if (warm && ((side == LOWER && s->lo[j] > -REAL_INFINITY) || (side == UPPER && s->hi[j] < REAL_INFINITY))) {
            exchange(s, search, j, side);
        }
    }
    search->exchanges = exchanges;
}

/* The variable whose multiplier vanishes first on the segment from `multiplier` to its present value; `length` is the
 * fraction of the segment. */
static int first_to_vanish(const Box *s, const Search *search, real *length)
{
    int first = -1;
    for (int i = 0; i < s->d; ++i) {
        if (s->side[i] != FREE && s->gain[i] > search->negligible) {
            const real u = s->multiplier[i], along = u / (u - s->basic[i]), t = along > 0 ? along : 0;
            if (first < 0 || t < *length) {
                first = i;
                *length = t;
            }
        }
    }
    return first;
}

/* The bound that the free variable j violates. */
static int broken_bound(const Box *s, int j) { return s->basic[j] > s->high[j] ? LOWER : UPPER; }

/* Move the free variable j to its bound, and release bounds until every multiplier is feasible. */
static void push(const Box *s, Search *search, int j)
{
    const int column = search->count, side = broken_bound(s, j);
    const real step = (side == LOWER ? s->lo[j] : s->hi[j]) + s->basic[j], t = step * s->weight[j];
    exchange(s, search, j, side);
    if (!(search->wrong > search->negligible)) {
        return;
    }
    for (int i = 0; i < s->d; ++i) { /* before the exchange */
        s->multiplier[i] = s->basic[i] - t * s->U[(size_t)column * (size_t)s->ld + (size_t)i];
    }
    s->multiplier[j] = 0;
    do {
        real length = 1;
        const int i = first_to_vanish(s, search, &length);
        for (int k = 0; k < s->d; ++k) {
            s->multiplier[k] += length * (s->basic[k] - s->multiplier[k]);
        }
        exchange(s, search, i, FREE);
    } while (search->wrong > search->negligible && search->count < 2 * s->ld);
}

/* g = q + P x to about twice the precision, then rounded once (Ogita, Rump & Oishi, SIAM J. Sci. Comput. 26 (2005)
 * 1955). The rounding error of a product follows from the halves of its factors (Dekker, Numer. Math. 18 (1971) 224).
 */
static void compensated_gradient(const Box *s, const real *linear)
{
    const vec8 splitter = splat(SPLITTER);
    for (int b = 0; b < s->ld; b += LANES) {
        vec8 high = load(linear + b), low = zeros();
        for (int j = 0; j < s->d; ++j) {
            const vec8 m = load(s->P + (size_t)j * (size_t)s->ld + b), t = splat(s->x[j]), product = mul(m, t);
            const vec8 total = add(high, product), added = sub(total, high);
            const vec8 of_sum = add(sub(high, sub(total, added)), sub(product, added));
            const vec8 m_wide = mul(splitter, m), m1 = sub(m_wide, sub(m_wide, m)), m2 = sub(m, m1);
            const vec8 t_wide = mul(splitter, t), t1 = sub(t_wide, sub(t_wide, t)), t2 = sub(t, t1);
            const vec8 of_product = add(add(add(sub(mul(m1, t1), product), mul(m1, t2)), mul(m2, t1)), mul(m2, t2));
            low = add(low, add(of_sum, of_product));
            high = total;
        }
        store(s->g + b, add(high, low));
    }
}

/* The gradient at x, with that of the proximal term. */
static void gradient(const Box *s, const Search *search)
{
    if (search->precise) {
        compensated_gradient(s, search->linear);
    } else {
        affine(s->P, s->ld, s->d, s->x, search->linear, s->g);
    }
    for (int b = 0; s->head->singular && b < s->ld; b += LANES) {
        store(s->g + b, plus_product(load(s->g + b), splat(BOX_PROXIMAL), load(s->x + b)));
    }
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

/* Refine x, recompute g, `basic` and the gains; whether g_F is zero to rounding. */
static int refine(const Box *s, Search *search)
{
    const int ld = s->ld, precise = search->precise;
    vec8 residual = zeros(), total = zeros(), broken = zeros(), wrong = zeros();
    for (int b = 0; b < ld; b += LANES) {
        store(s->x + b, sub_mul(load(s->held + b), load(s->is_free + b), load(s->basic + b)));
    }
    gradient(s, search);
    newton_step(s, search->count);
    gradient(s, search);
    ++s->head->refinements;
    search->precise = measure_rounding(s, search);
    search->slack = s->head->singular ? 4 * (real)s->d * search->rounding : 0;
    for (int j = 0; s->head->singular && j < s->d; ++j) {
        set_interval(s, j, search->slack);
    }
    const vec8 tolerance = splat(4 * (real)s->d * search->rounding);
    for (int b = 0; b < ld; b += LANES) {
        const vec8 g = load(s->g + b), free = load(s->is_free + b);
        const vec8 beyond = mul(sub(g, clip(g, sub(zeros(), tolerance), tolerance)), load(s->unit + b));
        const vec8 basic = sub(mul(sub(splat(1), free), beyond), mul(free, load(s->x + b)));
        residual = maximum(magnitude(mul(g, free)), residual);
        total = add(total, g);
        store(s->basic + b, basic);
        keep_gains(s, b, basic, load(s->weight + b), &broken, &wrong);
    }
    search->broken = largest8(broken);
    search->wrong = largest8(wrong);
    return largest8(residual) <= (real)(s->d + 4) * search->rounding / 2 && MAGNITUDE(sum8(total)) < REAL_INFINITY
           && precise >= search->precise;
}

/* Whether a multiplier is infeasible or a bound violated. */
static int is_unfinished(const Search *search)
{
    return search->wrong > search->negligible || search->broken > search->tolerated;
}

int box_dual_active_set(const Box *s, Search *search)
{
    const int columns = s->head->singular ? RENEWED_AFTER : 2 * s->ld - s->d;
    const int cap = s->head->cap, last = search->exchanges + (cap > 0 ? cap : 100 + 20 * s->d);
    const int greedy_exchanges = s->head->singular ? 0 : s->d;
    for (int round = 0; round < MOST_ROUNDS + (s->head->singular ? last : 0); ++round) {
        /* a push takes at most d columns of U */
        while (is_unfinished(search) && search->exchanges < last && search->count <= columns) {
            const int greedy = search->exchanges < greedy_exchanges;
            if (search->wrong > search->negligible && (!greedy || search->wrong >= search->broken)) {
                exchange(s, search, with_gain(s, search->wrong), FREE);
            } else if (greedy) {
                const int j = with_gain(s, search->broken);
                exchange(s, search, j, broken_bound(s, j));
            } else {
                push(s, search, with_gain(s, search->broken));
            }
        }
        if (s->head->singular && search->count > 0) {
            search->count = 0;
            if (!box_sweep_free(s)) {
                return BREAKDOWN;
            }
        } else if (search->count > columns) {
            box_begin(s, search, 1);
        }
        const int exact = refine(s, search);
        if (!is_unfinished(search) && exact) {
            return OK;
        }
        if (is_unfinished(search) && search->exchanges >= last) {
            return cap > 0 ? CAPPED : ENDLESS;
        }
    }
    return BREAKDOWN;
}
