/* The exact minimiser over a box by block principal pivoting on a factor, for data that exchanges on the inverse do not bring home.
 *
 * A guess of which variables F are free and which A sit at a bound leaves one candidate (box_newton). It is the minimiser iff
 * lb <= x_F <= ub, g_i >= 0 at lower and g_i <= 0 at upper bounds. Block principal pivoting (Judice & Pires, Computers & Operations
 * Research 21 (1994) 587; Kim & Park, SIAM J. Sci. Comput. 33 (2011) 3261) exchanges every variable that breaks this, all at once;
 * from "all free" it takes three systems at d = 18 and eight at d = 60. It may cycle, so where the number of broken conditions has
 * not reached a new low for PATIENCE rounds, box_dual.c ends the search. A bound has no tolerance; a multiplier below the rounding
 * of g counts as zero, which is what keeps ties from cycling.
 *
 * Singular P. Where a pivot of P or its smallest eigenvalue is below about 16 d eps, the problem solved has the term
 * delta |z - c|^2 / 2 more, in the scaled variables z (delta = BOX_PROXIMAL), and c moves to its answer until the term is below the
 * rounding of g (proximal point, Rockafellar, SIAM J. Control Optim. 14 (1976) 877). c starts at 0, or at the warm start: along
 * directions that P does not see, x stays where it was. P that has a pivot <= 0 even so is refused as indefinite; an x that walks on
 * at constant pace is taken to the next bound in its way, and where there is none the problem is unbounded.
 */
#include "box.h"

enum { PATIENCE = 5 }; /* 2 to 10 rounds take as many systems on average, 5 has the shortest tail */

#ifdef CORE_FLOAT
#define SPLITTER 4097.0F
#else
#define SPLITTER 134217729.0
#endif

/* g = q + P x to about twice the precision, then rounded once (Ogita, Rump & Oishi, SIAM J. Sci. Comput. 26 (2005) 1955). What
 * rounding takes from a product is found from the halves of its factors (Dekker, Numer. Math. 18 (1971) 224). */
static void gradient_compensated(Box *s)
{
    const vec8 splitter = splat(SPLITTER);
    for (int b = 0; b < s->ld; b += LANES) {
        vec8 high = load(s->q + b), low = zeros();
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

/* Write the side that each variable wants; how many want another, and in `residual` max |g_F|. */
static int judge(Box *s, real tolerance, real *residual)
{
    int broken = 0;
    *residual = 0;
    for (int j = 0; j < s->d; ++j) {
        const int side = s->side[j], outside = s->x[j] > s->hi[j] ? UPPER : s->x[j] < s->lo[j] ? LOWER : FREE;
        const int held = side == FIXED || (real)side * s->g[j] <= tolerance ? side : FREE;
        const int wanted = side == FREE ? outside : held;
        s->wanted[j] = wanted;
        broken += wanted != side;
        if (side == FREE && MAGNITUDE(s->g[j]) > *residual) {
            *residual = MAGNITUDE(s->g[j]);
        }
    }
    return broken;
}

/* Block principal pivoting from the sides as they are, with x and g = q + P x in step. */
static int pivot(Box *s)
{
    int best = s->d + 1, patience = PATIENCE, refined = 0;
    real linear = 0;
    for (int j = 0; j < s->d; ++j) {
        linear = MAGNITUDE(s->q[j]) > linear ? MAGNITUDE(s->q[j]) : linear;
    }
    linear *= 4 * (real)s->d * REAL_EPSILON;
    while (box_newton(s)) {
        const real tolerance = box_gradient_tolerance(s);
        real residual;
        const int broken = judge(s, tolerance, &residual);
        if (broken == 0) {
            const int large = tolerance > BOX_LARGE * linear;
            if (refined >= (large ? 2 : 1) || (!large && residual <= tolerance / 8)) {
                return OK;
            }
            ++refined;
            if (large) {
                gradient_compensated(s);
            }
            continue;
        }
        refined = 0;
        patience = broken < best ? PATIENCE : patience - 1;
        best = broken < best ? broken : best;
        if (s->head->cap > 0 && s->head->systems > s->head->cap) {
            return CAPPED;
        }
        if (patience == 0) {
            return box_dual_active_set(s);
        }
        for (int j = 0; j < s->d; ++j) {
            if (s->wanted[j] != s->side[j]) {
                box_move(s, j, s->wanted[j]);
            }
        }
        box_list_free(s);
    }
    return BREAKDOWN;
}

/* How many times the last proximal step fits before it meets a bound. */
static real reach_of(const Box *s, real negligible)
{
    real reach = REAL_INFINITY;
    for (int j = 0; j < s->d; ++j) {
        const real v = s->x[j] - s->centre[j];
        if (MAGNITUDE(v) > negligible) {
            const real times = ((v > 0 ? s->hi[j] : s->lo[j]) - s->x[j]) / v;
            reach = times < reach ? times : reach;
        }
    }
    return reach;
}

/* Solve the regularised problem again and again round its own answer. */
static int proximal_point(Box *s)
{
    const int d = s->d;
    real last = REAL_INFINITY;
    int status = OK;
    memcpy(s->centre, s->x, (size_t)s->ld * sizeof(real));
    for (int most = 20 + 2 * d; most > 0; --most) {
        real length = 0, rounding, reach = 0;
        ++s->head->proximal_steps;
        for (int j = 0; j < d; ++j) {
            s->q[j] = s->raw_q[j] * s->scale[j] - BOX_PROXIMAL * s->centre[j];
        }
        box_list_free(s);
        box_gradient(s);
        status = pivot(s);
        if (status != OK) {
            break;
        }
        for (int j = 0; j < d; ++j) {
            const real moved = MAGNITUDE(s->x[j] - s->centre[j]);
            length = moved > length ? moved : length;
        }
        rounding = box_gradient_tolerance(s);
        if (BOX_PROXIMAL * length <= rounding / 8) { /* the residual that is asked of g_F everywhere */
            break;
        }
        if ((real)0.99 * last < length && length < (real)1.01 * last && BOX_PROXIMAL * length > 16 * rounding) {
            reach = reach_of(s, (real)1e-9 * length);
            if (reach == REAL_INFINITY) {
                status = UNBOUNDED;
                break;
            }
        }
        for (int j = 0; j < d; ++j) {
            s->x[j] += reach * (s->x[j] - s->centre[j]);
            s->centre[j] = s->x[j];
        }
        last = length;
    }
    for (int j = 0; j < d; ++j) {
        s->q[j] = s->raw_q[j] * s->scale[j];
    }
    return status;
}

/* Cold, it starts with every variable free at 0 and the answer is a function of the data alone. Warm, it starts from the answer and
 * the sides in the state. */
/* From "all free", from the answer and its sides, or from sides alone. */
enum { COLD, WARM, GUESSED };

static int solve_from(Box *s, int start)
{
    int status = BREAKDOWN;
    if (!s->head->factorised) {
        status = box_factorise_copy(s);
        if (status != OK) {
            return status;
        }
    }
    for (int j = 0; j < s->d; ++j) {
        real x = 0;
        int side = FREE;
        if (start == WARM) {
            x = s->answer[j] / s->scale[j];
        }
        if (start != COLD) {
            side = s->side[j];
        }
        if (s->lo[j] == s->hi[j]) {
            side = FIXED;
        } else if (side == FIXED || (side == LOWER && s->lo[j] == -REAL_INFINITY) || (side == UPPER && s->hi[j] == REAL_INFINITY)) {
            side = FREE;
        }
        s->x[j] = side == FREE ? x : side == UPPER ? s->hi[j] : s->lo[j];
        s->side[j] = side;
    }
    s->head->systems = 0;
    box_list_free(s);
    status = BREAKDOWN;
    if (!s->head->singular) {
        box_gradient(s);
        status = pivot(s);
        if (status == BREAKDOWN && box_regularise(s) != OK) {
            return INDEFINITE;
        }
    }
    if (status == BREAKDOWN) {
        status = proximal_point(s);
    }
    for (int j = 0; j < s->d; ++j) { /* inside already, but for what rounding left the dual method */
        const real below = s->x[j] < s->hi[j] ? s->x[j] : s->hi[j];
        s->answer[j] = s->scale[j] * (below > s->lo[j] ? below : s->lo[j]);
    }
    return status;
}

int box_solve_factorised(Box *s, int warm) { return solve_from(s, warm ? WARM : COLD); }

int box_solve(Box *s, int warm)
{
    int start = warm ? WARM : COLD;
    s->head->exchanges = 0;
    s->head->systems = 0;
    s->head->dual_steps = 0;
    s->head->proximal_steps = 0;
    if (s->head->inverted) {
        const int status = box_exchange_all(s, warm);
        if (status != BREAKDOWN) {
            return status;
        }
    } else if (s->head->rough && !s->head->singular && s->head->cap == 0 && start == COLD) {
        box_exchange_all(s, 0); /* whatever its end, most of its sides are right */
        start = GUESSED;
    }
    ++s->head->fallbacks;
    return solve_from(s, start);
}

int box_solve_anew(Box *s, const real *P, const real *q, const real *lb, const real *ub)
{
    int status = box_take_bounds(s, lb, ub);
    status = status == OK ? box_take_hessian(s, P) : status;
    status = status == OK ? box_take_linear(s, q) : status;
    return status == OK ? box_solve(s, 0) : status;
}
