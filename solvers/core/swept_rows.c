/* The optimum of a box problem after every row (swept.h): the row in, the swept matrix moved by rank one, the optimum out.
 *
 * One more row xi changes G by xi xi', and M by a matrix of rank one as well (Sherman-Morrison on each block):
 *
 *     u = xi_A - M[:, F] xi_F,    sigma = 1 + xi_F'u_F,    M <- M + u u' / sigma.
 *
 * So a sample costs 2 (d + 1)^2 multiplications and no square root or division but one, a change of the active set half of that, and
 * the exact optimum is there after every sample. Forgetting is in the weights: row k enters with lambda^(-k/2) and the clock k starts
 * anew at each refresh.
 *
 * Refresh rule. M is made anew (swept_refresh.c) after SWEPT_REFRESH rows; where the weights have grown to GROWTH; and at the row that
 * would bring the product of the sigma since then, det G_FF after over before, to MOST_SURPRISE. A row that says what the data left
 * open has a large sigma, and adding it to M cancels log10 sigma digits of the entries; so between two refreshes M loses six digits
 * and SWEPT_REFRESH roundings at most, and the cost errs to second order in that. A sigma below one, which takes a lost positive
 * definiteness, and exchanges that do not end are answered in the same way.
 *
 * Source: L. Ljung, System Identification, 1999, chapter 11 (recursive least squares).
 */
#include "swept.h"

#define GROWTH 1e8
#define MOST_SURPRISE 1e6

/* G <- G + xi xi' and M <- M + u u'/sigma for the weighted row xi; 0 where M is left as it was for its sigma. */
static int add_row(Swept *s)
{
    const int d = s->d, ld = s->ld;
    const real *const row = s->row;
    real *const u = s->u, sigma, inverse;
    vec8 dot = zeros();
    int fits;
    for (int b = 0; b < ld; b += LANES) {
        const vec8 xi = load(row + b);
        store(u + b, less_product(xi, load(s->free + b), xi));
    }
    swept_subtract_free(s, s->M, row, u);
    for (int b = 0; b < ld; b += LANES) {
        dot = plus_product(dot, mul(load(s->free + b), load(row + b)), load(u + b));
    }
    sigma = 1 + sum8(dot);
    s->head->surprise *= (double)sigma;
    fits = sigma > (real)0.999 && s->head->surprise < MOST_SURPRISE; /* NaN does not fit */
    inverse = 1 / sigma;
    if (!fits) {
        inverse = 0;
        memset(u, 0, (size_t)ld * sizeof(real));
    }
    for (int i = 0; i <= d; ++i) {
        const vec8 factor = splat(u[i] * inverse), weight = splat(row[i]);
        real *const of_M = row_of(s, s->M, i), *const of_G = row_of(s, s->G, i);
        for (int b = 0; b < ld; b += LANES) {
            store(of_M + b, plus_product(load(of_M + b), factor, load(u + b)));
        }
        for (int b = i / LANES * LANES; b < ld; b += LANES) {
            store(of_G + b, plus_product(load(of_G + b), weight, load(row + b)));
        }
    }
    return fits;
}

int swept_take(Swept *s, const real *row)
{
    const int d = s->d;
    double weight;
    real target = row[d];
    int fits;
    for (int j = 0; j <= d; ++j) {
        if (!(MAGNITUDE(row[j]) < LARGEST_ENTRY)) {
            return NOT_FINITE;
        }
    }
    weight = s->head->root_weight *= s->head->root_growth;
    for (int j = 0; j < d; ++j) {
        target += s->origin[j] * row[j];
        s->row[j] = (real)weight * s->sign[j] * row[j];
    }
    s->row[d] = (real)weight * target;
    fits = add_row(s);
    ++s->head->since_refresh;
    if (s->head->since_refresh >= SWEPT_REFRESH || !fits || weight * weight >= GROWTH * s->head->row_weight) {
        return swept_refresh(s);
    }
    if (swept_violated(s)) {
        const int status = swept_exchange(s);
        return status == OK || status == CAPPED ? status : swept_refresh(s);
    }
    return OK;
}

void swept_answer(Swept *s)
{
    const real *const last = last_row(s);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 z = mul(load(s->free + b), sub(zeros(), load(last + b)));
        const vec8 v = plus_product(load(s->origin + b), load(s->sign + b), z);
        store(s->answer + b, clip(v, load(s->lb + b), load(s->ub + b)));
    }
}
