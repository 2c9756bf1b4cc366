/* The swept Gram matrix (recursive.h) made anew: on the set of free variables as it is, or from a cold exact solve.
 *
 * Rounding errors of M grow with the rows added to it (recursive_rows.c says when they are not let grow further). G, to
 * which rows are added and nothing else, has errors of its last bits only. So M is swept afresh from
 *
 *     G + diag(rho),    rho_j (z_j - c_j)^2/2 the proximal term about c, the z of now,
 *
 * and its last row m, which is z and the gradient, takes steps of iterative refinement from where it was:
 *
 *     m_A <- g_A,    m <- m - sum over j in F of g_j M[j, :],    g = q + (G + diag rho) z - diag(rho) c.
 *
 * What the data do not determine thus stays where it is. rho_j is `proximal` times G_jj, at most the mean diagonal of
 * G, and that where G_jj = 0: a variable on a large scale must not hold those on a small one. Where G_FF is singular to
 * rounding even so, or the exchanges afterwards do not end, M is made anew with rho_j at least FLOOR G_jj.
 *
 * If the exchanges do not end even so, recursive_recover hands P and q, read back from G, to the cold exact solver
 * (which knows when a problem is unbounded) and M is swept on its active set; so every start begins too. There a step
 * of refinement is taken back where it leaves a larger error than the cold answer has: the inverse of what is all but
 * singular has no digit to refine with. What is left as an error is a problem that has no minimum: unbounded, or P
 * indefinite.
 *
 * Sources: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, chapter 12 (iterative refinement); R. T.
 * Rockafellar, SIAM J. Control Optim. 14 (1976) 877 (proximal point).
 */
#include "recursive.h"

/* Refinement ends where a step gains less than SETTLED times the one before, or RESOLVED times the cost; G_FF counts as
 * singular where that is still more than TOLERATED times the cost, or 1e-4 of what z = 0 costs. */
#define SETTLED ((real)1e-3)
#define RESOLVED ((real)1e-24)
#define TOLERATED ((real)1e-14)
#ifdef CORE_FLOAT
#define UNSEEN 1e-30F /* rho_j where the data say nothing on variable j, whatever their scale */
#else
#define UNSEEN 1e-200
#endif

/* Multiply G so that the coming row enters with its own weight, and fill in its lower triangle. */
static void unwind(Recursive *s)
{
    const vec8 shrink = splat((real)(s->head->row_weight / (s->head->root_weight * s->head->root_weight)));
    s->head->root_weight = sqrt(s->head->row_weight);
    for (int i = 0; i <= s->d; ++i) {
        real *const row = row_of(s, s->G, i);
        for (int b = i / LANES * LANES; b < s->ld; b += LANES) {
            store(row + b, mul(load(row + b), shrink));
        }
    }
    recursive_complete(s, s->G);
}

void recursive_unswept(Recursive *s, real floor)
{
    const int d = s->d;
    real trace = 0;
    for (int j = 0; j < d; ++j) {
        trace += row_of(s, s->G, j)[j];
    }
    memcpy(s->M, s->G, (size_t)(d + 1) * (size_t)s->ld * sizeof(real));
    for (int j = 0; j < d; ++j) {
        const real diagonal = row_of(s, s->G, j)[j], mean = trace / (real)d;
        real rho = (real)s->head->proximal * (diagonal > 0 && diagonal < mean ? diagonal : mean);
        if (floor > 0) {
            rho = rho > floor * diagonal ? rho : floor * diagonal;
            rho = rho > UNSEEN ? rho : UNSEEN;
        }
        s->rho[j] = rho;
        row_of(s, s->M, j)[j] += rho;
        row_of(s, s->M, j)[d] -= rho * s->centre[j];
        last_row(s)[j] -= rho * s->centre[j];
    }
}

/* Sweep M on F from G + diag(rho) and q - rho c; the last row is left at z = c. OK or SINGULAR. */
static int factorise(Recursive *s, real floor)
{
    s->head->since_refresh = s->head->renewing = 0;
    s->head->growth = floor > 0 ? SPENT : 1;
    ++s->head->refreshes;
    recursive_unswept(s, floor);
    if (!recursive_sweep_free(s)) {
        return SINGULAR;
    }
    for (int j = 0; j < s->d; ++j) {
        if (s->free[j] > 0) {
            last_row(s)[j] = row_of(s, s->M, j)[s->d] = -s->centre[j];
        }
    }
    return OK;
}

/* g = q + (G + diag rho) z - diag(rho) c, of which the blocks of G from the diagonal on are read, each for its
 * transpose, too. */
static void residual(Recursive *s)
{
    const real *const last = last_row(s);
    real *const z = s->u;
    for (int b = 0; b < s->ld; b += LANES) {
        store(z + b, sub(zeros(), mul(load(s->free + b), load(last + b))));
        store(s->g + b, mul(load(s->rho + b), sub(load(z + b), load(s->centre + b))));
    }
    z[s->d] = 1; /* q is the last column of G */
    for (int i = 0; i <= s->d; ++i) {
        const real *const row = row_of(s, s->G, i);
        const int own = i / LANES * LANES;
        const vec8 share = splat(z[i]);
        vec8 dot = zeros();
        store(s->g + own, plus_product(load(s->g + own), share, load(row + own)));
        for (int b = own + LANES; b < s->ld; b += LANES) {
            const vec8 entries = load(row + b);
            store(s->g + b, plus_product(load(s->g + b), share, entries));
            dot = plus_product(dot, load(z + b), entries);
        }
        s->g[i] += sum8(dot);
    }
}

real recursive_refine(Recursive *s)
{
    const int d = s->d;
    real *const last = last_row(s), gain = 0;
    residual(s);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 free = load(s->free + b);
        store(last + b, plus_product(mul(free, load(last + b)), sub(splat(1), free), load(s->g + b)));
    }
    recursive_subtract_free(s, s->M, s->g, last);
    for (int j = 0; j < d; ++j) {
        gain += s->free[j] * s->g[j] * (last[j] - row_of(s, s->M, j)[d]);
        row_of(s, s->M, j)[d] = last[j];
    }
    return gain;
}

int recursive_tolerable(const Recursive *s, real gain)
{
    const real cost = MAGNITUDE(last_row(s)[s->d]), q_cost = row_of(s, s->G, s->d)[s->d];
    return gain <= TOLERATED * (cost > (real)1e-4 * q_cost ? cost : (real)1e-4 * q_cost);
}

/* Make M anew with the proximal term about the present z, refine z and exchange; OK, CAPPED, SINGULAR or CYCLING. */
int recursive_refresh(Recursive *s)
{
    const real *const last = last_row(s);
    int status = SINGULAR;
    unwind(s);
    for (int b = 0; b < s->ld; b += LANES) {
        store(s->centre + b, sub(zeros(), load(last + b)));
    }
    for (int floored = 0; floored < 2; ++floored) {
        uint32_t exchanges = s->head->exchanges - 1;
        for (int b = 0; b < s->ld; b += LANES) {
            store(s->centre + b, mul(load(s->free + b), load(s->centre + b)));
        }
        status = factorise(s, floored ? FLOOR : 0);
        while (status == OK && exchanges != s->head->exchanges) {
            real before, wrong = recursive_refine(s), enough;
            exchanges = s->head->exchanges;
            for (int k = 0; k < 3; ++k) {
                before = wrong;
                wrong = recursive_refine(s);
                enough = RESOLVED * MAGNITUDE(last[s->d]);
                enough = enough > SETTLED * before ? enough : SETTLED * before;
                if (!(wrong > enough)) {
                    break;
                }
            }
            status = !floored && !recursive_tolerable(s, wrong) ? SINGULAR : recursive_exchange(s);
        }
        if (status == OK || status == CAPPED) {
            return status;
        }
    }
    return status;
}

/* Where the cold solver put variable j: the bound that z is measured from, and z if j is free. */
static void place_variable(Recursive *s, int j)
{
    const real lb = s->lb[j], ub = s->ub[j];
    const int side = s->cold.side[j], is_free = side == FREE && lb < ub;
    const int lower = lb > -NO_BOUND, upper = ub < NO_BOUND, from_above = upper && (side == UPPER || !lower);
    s->origin[j] = from_above ? ub : lower ? lb : 0;
    s->sign[j] = from_above ? -1 : 1;
    s->width[j] = lower && upper ? ub - lb : NO_BOUND;
    s->free[j] = is_free ? 1 : 0;
    s->side[j] = !((lower || upper) && lb < ub) ? 0 : is_free ? -1 : 1;
    s->centre[j] = is_free ? s->sign[j] * (s->cold.answer[j] - s->origin[j]) : 0;
}

/* The last row at z = c, with the gradient there. */
static void stand_at_centre(Recursive *s)
{
    for (int j = 0; j < s->d; ++j) {
        last_row(s)[j] = -s->centre[j]; /* zero at A */
    }
    residual(s);
    for (int j = 0; j < s->d; ++j) {
        last_row(s)[j] = row_of(s, s->M, j)[s->d] = s->free[j] > 0 ? -s->centre[j] : s->g[j];
    }
}

int recursive_begin(Recursive *s, const real *P, const real *q, real constant, int warm)
{
    const int d = s->d;
    int status = box_take_hessian(&s->cold, P);
    real refined;
    status = status != OK ? status : box_take_linear(&s->cold, q);
    if (status != OK) {
        return status;
    }
    status = ENDLESS;
    if (warm && box_start(&s->cold, s->answer) == OK) {
        status = box_solve(&s->cold, 1);
    }
    if (status != OK && status != UNBOUNDED) {
        status = box_solve(&s->cold, 0);
    }
    if (status != OK) {
        return status;
    }
    for (int j = 0; j < d; ++j) {
        place_variable(s, j);
    }
    memset(s->M, 0, 2 * (size_t)s->ld * (size_t)s->ld * sizeof(real));
    for (int i = 0; i < d; ++i) {
        real *const row = row_of(s, s->G, i), shifted = q[i];
        for (int j = 0; j < d; ++j) {
            shifted += P[i * d + j] * s->origin[j];
            row[j] = s->sign[i] * ((P[i * d + j] + P[j * d + i]) / 2) * s->sign[j];
        }
        row[d] = row_of(s, s->G, d)[i] = s->sign[i] * shifted;
        constant += s->origin[i] * (q[i] + shifted);
    }
    row_of(s, s->G, d)[d] = constant;
    s->head->root_weight = sqrt(s->head->row_weight);
    recursive_list_free(s);
    if (factorise(s, 0) != OK) {
        factorise(s, FLOOR);
    }
    recursive_refine(s);
    refined = recursive_error(s);
    memcpy(s->row, last_row(s), (size_t)s->ld * sizeof(real));
    stand_at_centre(s);
    if (refined <= recursive_error(s)) {
        memcpy(last_row(s), s->row, (size_t)s->ld * sizeof(real));
        for (int j = 0; j < d; ++j) {
            row_of(s, s->M, j)[d] = s->row[j];
        }
    } else {
        s->head->growth = SPENT;
    }
    return OK;
}

int recursive_recover(Recursive *s)
{
    const int d = s->d;
    real constant;
    unwind(s);
    constant = row_of(s, s->G, d)[d];
    for (int i = 0; i < d; ++i) {
        const real *const row = row_of(s, s->G, i);
        s->q[i] = s->sign[i] * row[d];
        for (int j = 0; j < d; ++j) {
            s->P[i * d + j] = s->sign[i] * row[j] * s->sign[j];
            s->q[i] -= s->P[i * d + j] * s->origin[j];
        }
    }
    for (int i = 0; i < d; ++i) {
        constant -= s->origin[i] * (s->q[i] + s->sign[i] * row_of(s, s->G, i)[d]);
    }
    ++s->head->cold_starts;
    return recursive_begin(s, s->P, s->q, constant, 1);
}

real recursive_error(Recursive *s)
{
    const real *const last = last_row(s), *const q = row_of(s, s->G, s->d);
    real worst = 0;
    /* z inside its box, as it is answered; it has a bound at zero where `side` is not */
    for (int j = 0; j < s->d; ++j) {
        const real z = -s->free[j] * last[j], up = z < 0 && (s->side[j] != 0 || s->width[j] < NO_BOUND) ? 0 : z;
        s->u[j] = up > s->width[j] ? s->width[j] : up;
    }
    for (int i = 0; i < s->d; ++i) {
        const real *const row = row_of(s, s->G, i);
        const real z = s->u[i];
        real g = q[i] + s->rho[i] * (z - s->centre[i]), size = MAGNITUDE(q[i]), wrong;
        for (int j = 0; j < s->d; ++j) {
            const real term = (j / LANES < i / LANES ? row_of(s, s->G, j)[i] : row[j]) * s->u[j];
            g += term;
            size += MAGNITUDE(term);
        }
        wrong = s->width[i] == 0 || (z == 0 && s->side[i] != 0 && g > 0) || (z == s->width[i] && g < 0) ? g - g
                                                                                                        : MAGNITUDE(g);
        worst = wrong <= worst * size ? worst : wrong / size; /* NaN is wrong */
    }
    return worst;
}
