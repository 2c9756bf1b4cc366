/* The optimum of a box problem after every row (recursive.h), by an update of the swept matrix of rank one.
 *
 * A new row xi changes G by xi xi', and M by a matrix of rank one too (Sherman-Morrison on each block):
 *
 *     u = xi_A - M[:, F] xi_F,    sigma = 1 + xi_F'u_F,    M <- M + u u' / sigma.
 *
 * So a sample costs 2 (d + 1)^2 multiplications and one division, a change of the active set half of that, and the
 * exact optimum is known after every sample. Forgetting is part of the weights: row k is added with weight
 * lambda^(-k/2); all weights are rescaled when they have grown to RESCALED^2.
 *
 * Refresh rule. M is recomputed (recursive_renewal.c) after RECURSIVE_REFRESH rows, and at the row at which the product
 * of the sigma since then, which is the growth of det G_FF, would reach MOST_GROWTH. A row in a direction that the data
 * did not determine has a large sigma, and adding it to M cancels log10 sigma digits of the entries; so between two
 * refreshes M loses at most six digits and RECURSIVE_REFRESH roundings, and the error of the cost is of second order in
 * that. A sigma below one (lost positive definiteness) and exchanges that do not end cause a refresh at once.
 *
 * Source: L. Ljung, System Identification, 1999, chapter 11 (recursive least squares).
 */
#include "recursive.h"

#include "product.h"

#define RESCALED ((real)8192) /* 2^13 */
#define MOST_GROWTH 1e6

/* Update M by the weighted row; 0 if sigma does not permit it and M is unchanged. */
static int move(const Recursive *s)
{
    const int ld = s->ld;
    vec8 dot = zeros();
    for (int b = 0; b < ld; b += LANES) {
        const vec8 xi = load(s->row + b), of_free = mul(load(s->is_free + b), xi);
        store(s->share + b, sub(zeros(), of_free));
        store(s->u + b, sub(xi, of_free));
    }
    affine(s->M, ld, s->d, s->share, s->u, s->u);
    for (int b = 0; b < ld; b += LANES) {
        dot = sub_mul(dot, load(s->share + b), load(s->u + b));
    }
    const real sigma = 1 + sum8(dot), inverse = 1 / sigma;
    s->head->growth *= (double)sigma;
    if (!(sigma > (real)0.999 && s->head->growth < MOST_GROWTH)) { /* also if it is NaN */
        return 0;
    }
    for (int i = 0; i <= s->d; ++i) {
        const vec8 factor = splat(s->u[i] * inverse);
        real *const of_M = row_of(s, s->M, i);
        for (int b = 0; b < ld; b += LANES) {
            store(of_M + b, plus_product(load(of_M + b), factor, load(s->u + b)));
        }
    }
    return 1;
}

/* G <- G + xi xi'. */
static void add_row(Recursive *s)
{
    const real *const row = s->row;
    for (int i = 0; i <= s->d; ++i) {
        const vec8 weight = splat(row[i]);
        real *const of_G = row_of(s, s->G, i);
        for (int b = i / LANES * LANES; b < s->ld; b += LANES) {
            store(of_G + b, plus_product(load(of_G + b), weight, load(row + b)));
        }
    }
}

/* Divide all weights by RESCALED^2, a power of two, so without rounding: G and M_AA shrink, M_FF grows. */
static void rescale(Recursive *s)
{
    const vec8 shrink = splat(1 / (RESCALED * RESCALED));
    for (int j = 0; j < s->ld; ++j) {
        s->u[j] = s->is_free[j] > 0 ? RESCALED : 1 / RESCALED;
    }
    for (int i = 0; i <= s->d; ++i) {
        real *const of_M = row_of(s, s->M, i), *const of_G = row_of(s, s->G, i);
        for (int b = 0; b < s->ld; b += LANES) {
            store(of_M + b, mul(load(of_M + b), mul(load(s->u + b), splat(s->u[i]))));
            store(of_G + b, mul(load(of_G + b), shrink));
        }
    }
    for (int b = 0; b < s->ld; b += LANES) {
        store(s->rho + b, mul(load(s->rho + b), shrink));
    }
    s->head->root_weight /= (double)RESCALED;
}

int recursive_append(Recursive *s, const real *row)
{
    const int d = s->d;
    real target = row[d];
    int status = OK;
    for (int j = 0; j <= d; ++j) {
        if (!(MAGNITUDE(row[j]) < LARGEST_ENTRY)) {
            return NOT_FINITE;
        }
    }
    while (s->head->root_weight * s->head->root_weight >= (double)(RESCALED * RESCALED) * s->head->row_weight) {
        rescale(s);
    }
    s->head->root_weight *= s->head->root_growth;
    const real weight = (real)s->head->root_weight;
    for (int j = 0; j < d; ++j) {
        target += s->origin[j] * row[j];
        s->row[j] = weight * s->sign[j] * row[j];
    }
    s->row[d] = weight * target;
    const int moved = move(s);
    add_row(s);
    ++s->head->since_refresh;
    if (!moved || s->head->since_refresh >= RECURSIVE_REFRESH) {
        return recursive_refresh(s);
    }
    if (recursive_violated(s)) {
        status = recursive_exchange(s);
    }
    return status == OK || status == CAPPED ? status : recursive_refresh(s);
}

void recursive_answer(Recursive *s)
{
    const real *const last = last_row(s);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 z = mul(load(s->is_free + b), sub(zeros(), load(last + b)));
        const vec8 v = plus_product(load(s->origin + b), load(s->sign + b), z);
        store(s->answer + b, clip(v, load(s->lb + b), load(s->ub + b)));
    }
}
