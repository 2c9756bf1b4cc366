/* Exchanges between free variables and bounds until a box problem with a swept Gram matrix (recursive.h) is at its
 * optimum.
 *
 * Freeing or fixing variable j is one sweep (sweep.h). A variable whose entry of the last row of M has the wrong sign
 * is exchanged, the one with the largest e^2/|M_jj| first, with e its violation: half of that is the gain of
 * leaving the bound, or the cost of keeping it. The rule usually needs few exchanges but may cycle, so CYCLING is
 * returned after LIMIT + d of them. If a cap is reached, M is right for the present set of free variables, the answer
 * is clipped, and the next row continues the exchanges.
 *
 * Source: R. W. Cottle, "Principal pivoting method of quadratic programming", 1968.
 */
#include "recursive.h"

#include "sweep.h"

enum { LIMIT = 20 }; /* limit of exchanges besides d; a row of a stream mostly takes none or one */
/* Largest gain of an exchange that is ignored, relative to the optimal cost; for a free variable, which is then
 * clipped, also the cost of clipping it. */
#define NEGLIGIBLE ((real)1e-15)

int recursive_sweep(const Recursive *s, int j)
{
    const real p = row_of(s, s->M, j)[j];
    /* p of a variable at its bound is the Schur complement of F in this diagonal entry: */
    const real diagonal = row_of(s, s->G, j)[j] + s->rho[j];
    if (!(s->is_free[j] > 0 ? p < 0 : p > 5 * (real)s->d * REAL_EPSILON * diagonal)) {
        return 0;
    }
    sweep(s->M, s->d + 1, s->ld, j, s->u);
    s->is_free[j] = 1 - s->is_free[j];
    return 1;
}

/* Whether any entry of the last row of M has the wrong sign. */
int recursive_violated(const Recursive *s)
{
    const real *const last = last_row(s);
    vec8 worst = zeros();
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 value = load(last + b);
        const vec8 room = mul(load(s->is_free + b), add(load(s->width + b), value));
        worst = minimum(worst, minimum(mul(load(s->side + b), value), room));
    }
    return sum8(worst) < 0;
}

/* Measure the free variable j from its other bound, z_j <- width - z_j: xi_j changes sign, and x becomes x + width
 * xi_j. */
static void reflect(Recursive *s, int j)
{
    const int d = s->d;
    const real width = s->width[j];
    real *const row = row_of(s, s->G, j), *const last = row_of(s, s->G, d), *const swept = row_of(s, s->M, j);
    s->origin[j] = s->sign[j] > 0 ? s->ub[j] : s->lb[j];
    s->sign[j] = -s->sign[j];
    s->centre[j] = width - s->centre[j];
    recursive_complete(s);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 entries = load(row + b);
        store(last + b, plus_product(load(last + b), splat(width), entries));
        store(row + b, sub(zeros(), entries));
        store(swept + b, sub(zeros(), load(swept + b)));
    }
    for (int i = 0; i <= d; ++i) {
        real *const of_row = row_of(s, s->G, i);
        of_row[d] += width * of_row[j];
        of_row[j] = -of_row[j];
        row_of(s, s->M, i)[j] = -row_of(s, s->M, i)[j];
    }
    last_row(s)[j] -= width;
    swept[d] -= width;
}

/* Exchange variables until z is optimal, the one that gains most first; OK, CAPPED, SINGULAR or CYCLING. */
int recursive_exchange(Recursive *s)
{
    const int d = s->d;
    const real *const last = last_row(s);
    for (int done = 0; done < LIMIT + d; ++done) {
        int chosen = -1, beyond = 0;
        const real least = NEGLIGIBLE * MAGNITUDE(last[d]);
        real most = 0;
        for (int j = 0; j < d; ++j) {
            const real below = -s->side[j] * last[j], above = -(s->width[j] + last[j]) * s->is_free[j];
            const real size = above > below ? above : below;
            if (size > 0) {
                const real square = size * size, gain = square / MAGNITUDE(row_of(s, s->M, j)[j]);
                if (gain > most && (gain > least || s->is_free[j] * square * row_of(s, s->G, j)[j] > least)) {
                    chosen = j;
                    beyond = above > below;
                    most = gain;
                }
            }
        }
        if (chosen < 0) {
            return OK;
        }
        if (s->head->cap > 0 && done >= s->head->cap) {
            return CAPPED;
        }
        if (beyond) {
            reflect(s, chosen);
        }
        if (!recursive_sweep(s, chosen)) {
            return SINGULAR;
        }
        s->side[chosen] = -s->side[chosen];
        ++s->head->exchanges;
    }
    return CYCLING;
}
