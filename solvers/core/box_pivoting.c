/* The exact minimiser over a box by block pivoting, for data that exchanges on the inverse do not bring home.
 *
 * The rounds are those of block_pivoting.c, cold from its guess, and the last of them refine the answer. They may
 * cycle, so where the number of broken conditions has not reached a new low for PATIENCE rounds, box_dual.c ends the
 * search (Kim & Park, SIAM J. Sci. Comput. 33 (2011) 3261).
 *
 * Singular P. Where a pivot of P or its smallest eigenvalue is below about 16 d eps, the problem solved has the term
 * delta |z - c|^2 / 2 more, in the scaled variables z (delta = BOX_PROXIMAL), and c moves to its answer until the term
 * is below the rounding of g (proximal point, Rockafellar, SIAM J. Control Optim. 14 (1976) 877). c starts at 0, or at
 * the warm start: along directions that P does not see, x stays where it was. P that has a pivot <= 0 even so is
 * refused as indefinite; an x that walks on at constant pace is taken to the next bound in its way, and where there is
 * none the problem is unbounded.
 */
#include "box_fallback.h"

enum { PATIENCE = 5 }; /* 2 to 10 rounds take as many systems on average, 5 has the shortest tail */

#ifdef CORE_FLOAT
#define SPLITTER 4097.0F
#else
#define SPLITTER 134217729.0
#endif

/* g = q + P x to about twice the precision, then rounded once (Ogita, Rump & Oishi, SIAM J. Sci. Comput. 26 (2005)
 * 1955). What rounding takes from a product is found from the halves of its factors (Dekker, Numer. Math. 18 (1971)
 * 224). */
static void gradient_compensated(const Pivoting *p)
{
    const vec8 splitter = splat(SPLITTER);
    for (int b = 0; b < VECTORS(p->d); ++b) {
        vec8 high = vector(p->q, b), low = zeros();
        for (int j = 0; j < p->d; ++j) {
            const vec8 m = vector(row_of(p, j), b), t = splat(p->x[j]), product = mul(m, t);
            const vec8 total = add(high, product), added = sub(total, high);
            const vec8 of_sum = add(sub(high, sub(total, added)), sub(product, added));
            const vec8 m_wide = mul(splitter, m), m1 = sub(m_wide, sub(m_wide, m)), m2 = sub(m, m1);
            const vec8 t_wide = mul(splitter, t), t1 = sub(t_wide, sub(t_wide, t)), t2 = sub(t, t1);
            const vec8 of_product = add(add(add(sub(mul(m1, t1), product), mul(m1, t2)), mul(m2, t1)), mul(m2, t2));
            low = add(low, add(of_sum, of_product));
            high = total;
        }
        set_vector(p->g, b, add(high, low));
    }
    end_gradient(p);
}

/* A linear system with the sides as they are; 0 where P_FF is not positive definite to rounding. */
static int newton(const Fallback *f, int precise)
{
    pivoting_place(&f->program);
    if (precise) {
        gradient_compensated(&f->program);
    }
    ++f->head->systems;
    return pivoting_newton(&f->program, 0) > 0;
}

int box_newton(const Fallback *f) { return newton(f, 0); }

static real largest(const real *a, int d)
{
    real most = 0;
    for (int j = 0; j < d; ++j) {
        most = MAGNITUDE(a[j]) > most ? MAGNITUDE(a[j]) : most;
    }
    return most;
}

/* Block principal pivoting from the sides as they are. */
static int pivot(const Fallback *f)
{
    const Pivoting *const p = &f->program;
    int best = p->d + 1, patience = PATIENCE, refined = 0, large = 0;
    while (newton(f, refined > 0 && large)) {
        real residual;
        const int broken = (int)pivoting_exchange(p, &residual);
        if (broken == 0) {
            large = largest(p->x, p->d) > BOX_LARGE * largest(p->q, p->d);
            if (residual == REAL_INFINITY) {
                return BREAKDOWN;
            }
            if (refined >= (large ? 2 : 1) || (!large && residual <= (real)0.125)) {
                return OK;
            }
            ++refined;
            continue;
        }
        refined = 0;
        patience = broken < best ? PATIENCE : patience - 1;
        best = broken < best ? broken : best;
        if (f->head->cap > 0 && f->head->systems > f->head->cap) {
            return CAPPED;
        }
        if (patience == 0) {
            return box_dual_active_set(f);
        }
    }
    return BREAKDOWN;
}

/* How many times the last proximal step fits before it meets a bound. */
static real reach_of(const Fallback *f, real negligible)
{
    const Pivoting *const p = &f->program;
    real reach = REAL_INFINITY;
    for (int j = 0; j < p->d; ++j) {
        const real v = p->x[j] - f->centre[j];
        if (MAGNITUDE(v) > negligible) {
            const real times_it = ((v > 0 ? p->ub[j] : p->lb[j]) - p->x[j]) / v;
            reach = times_it < reach ? times_it : reach;
        }
    }
    return reach;
}

/* Solve the regularised problem, with the linear term q but for c, again and again round its own answer. */
static int proximal_point(const Fallback *f, const real *q)
{
    const Pivoting *const p = &f->program;
    const int d = p->d;
    real last = REAL_INFINITY;
    int status = OK;
    memcpy(f->centre, p->x, (size_t)d * sizeof(real));
    for (int most = 20 + 2 * d; most > 0; --most) {
        real length = 0, rounding, reach = 0;
        ++f->head->proximal_steps;
        for (int j = 0; j < d; ++j) {
            p->q[j] = q[j] - BOX_PROXIMAL * f->centre[j];
        }
        status = pivot(f);
        if (status != OK) {
            break;
        }
        for (int j = 0; j < d; ++j) {
            const real moved = MAGNITUDE(p->x[j] - f->centre[j]);
            length = moved > length ? moved : length;
        }
        rounding = pivoting_rounding(p);
        if (BOX_PROXIMAL * length <= rounding / 8) { /* the residual that is asked of g_F everywhere */
            break;
        }
        if ((real)0.99 * last < length && length < (real)1.01 * last && BOX_PROXIMAL * length > 16 * rounding) {
            reach = reach_of(f, (real)1e-9 * length);
            if (reach == REAL_INFINITY) {
                return UNBOUNDED;
            }
        }
        for (int j = 0; j < d; ++j) {
            p->x[j] += reach * (p->x[j] - f->centre[j]);
            f->centre[j] = p->x[j];
        }
        last = length;
    }
    return status;
}

/* The data, and where to begin: warm at the answer and its sides, cold at a guess, which makes the answer a function of
 * the data alone. */
static void begin(const Fallback *f, const Box *s, int warm)
{
    const Pivoting *const p = &f->program;
    for (int j = 0; j < s->d; ++j) {
        p->q[j] = s->q[j];
        p->lb[j] = s->lo[j];
        p->ub[j] = s->hi[j];
    }
    if (!warm) {
        pivoting_guess(p, 1);
    }
    for (int j = 0; j < s->d; ++j) {
        const real lo = s->lo[j], hi = s->hi[j], x = s->answer[j] / s->scale[j],
                   side = warm ? (real)s->side[j] : p->side[j];
        const int held = (side < 0 && lo > -REAL_INFINITY) || (side > 0 && hi < REAL_INFINITY);
        p->x[j] = warm && MAGNITUDE(x) < REAL_INFINITY ? x : 0;
        p->side[j] = lo == hi ? LOWER : held ? side : FREE;
    }
    pivoting_place(p);
}

int box_solve_factorised(Box *s, int warm)
{
    const Fallback f = fallback_at(s);
    const Pivoting *const p = &f.program;
    int status = s->head->factorised ? OK : box_factorise_copy(s);
    if (status != OK) {
        return status;
    }
    f.head->systems = 0;
    if (!f.head->singular) {
        begin(&f, s, warm);
        status = pivot(&f);
        if (status == BREAKDOWN && box_regularise(&f) != OK) {
            return INDEFINITE;
        }
    }
    if (f.head->singular) {
        begin(&f, s, warm);
        status = proximal_point(&f, s->q);
    }
    for (int j = 0; j < s->d; ++j) { /* inside already, but for what rounding left the dual method */
        s->x[j] = within(p->x[j], s->lo[j], s->hi[j]);
        s->answer[j] = s->scale[j] * s->x[j];
        s->g[j] = p->g[j];
        s->side[j] = (int32_t)p->side[j];
    }
    return status;
}

int box_solve(Box *s, int warm)
{
    s->head->exchanges = 0;
    s->head->systems = 0;
    s->head->dual_steps = 0;
    s->head->proximal_steps = 0;
    if (s->head->inverted) {
        const int status = box_exchange_all(s, warm);
        if (status != BREAKDOWN) {
            return status;
        }
    }
    ++s->head->fallbacks;
    return box_solve_factorised(s, warm);
}

int box_solve_anew(Box *s, const real *P, const real *q, const real *lb, const real *ub)
{
    int status = box_take_bounds(s, lb, ub);
    status = status == OK ? box_take_hessian(s, P) : status;
    status = status == OK ? box_take_linear(s, q) : status;
    return status == OK ? box_solve(s, 0) : status;
}
