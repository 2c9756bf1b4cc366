/* P^-1 of the scaled data of a box problem, by sweeps in passes of two variables.
 *
 * Swept on the variables F, with R the others, P becomes the symmetric matrix M with
 *
 *     M_FF = -P_FF^-1,    M_FR = P_FF^-1 P_FR,    M_RR = P_RR - P_RF P_FF^-1 P_FR,
 *
 * and sweeping two more, K in R, with H = M_KK^-1 and N all but K, is
 *
 *     M_NN <- M_NN - M_NK H M_KN,    M_KN <- H M_KN,    M_KK <- -H.
 *
 * On every variable, M = -P^-1. P is positive definite iff every H on the way is, and 1/lambda_min(P) <= trace P^-1,
 * which a triangular factor does not show; a P that is not safely inside both is left to box_data.c. Two pivots a pass
 * halve the loads and stores of M and share one division, whose wait is filled by the last rows of the pass before: the
 * rows of the next pair come first.
 *
 * Symmetry is seen in one number: sum K_ij P_ij, with K irregular and K' = -K, is zero to rounding where P is
 * symmetric. K_ij = sign_i sign_j skew(j - i) takes two vectors.
 *
 * Sources: A. E. Beaton, The use of special matrix operators in statistical calculus, ETS RB-64-51, 1964; J. H.
 * Goodnight, "A tutorial on the SWEEP operator", American Statistician 33 (1979) 149.
 */
#include "box.h"

#include "product.h"

/* Diagonal entry of P^-1, at unit diagonal of P, up to which two steps of refinement make an answer exact. */
#define LARGEST_INVERSE ((real)1e9)

/* Scale, and S P S by rows; the sum of K_ij (S P S)_ij. */
static real copy_scaled(Box *s, const real *P)
{
    const int d = s->d, ld = s->ld;
    vec8 total = zeros();
    for (int j = 0; j < ld; ++j) {
        s->scale[j] = j < d ? P[j * d + j] : 1;
    }
    for (int j = 0; j < ld; j += LANES) {
        store(s->scale + j, root_scale(load(s->scale + j)));
    }
    for (int i = 0; i < d; ++i) {
        const real *const row = P + (size_t)i * (size_t)d, *const skew = s->skew + ld - i;
        real *const to = s->P + (size_t)i * (size_t)ld;
        const vec8 scale = splat(s->scale[i]);
        vec8 uneven = zeros();
        for (int j = 0; j + LANES < ld; j += LANES) {
            const vec8 entries = mul(load(row + j), mul(scale, load(s->scale + j)));
            uneven = plus_product(uneven, entries, mul(load(skew + j), load(s->sign + j)));
            store(to + j, entries);
        }
        {
            const int j = ld - LANES;
            const vec8 entries = mul(load_first(row + j, d - j), mul(scale, load(s->scale + j)));
            uneven = plus_product(uneven, entries, mul(load(skew + j), load(s->sign + j)));
            store(to + j, entries);
        }
        total = plus_product(total, uneven, splat(s->sign[i]));
    }
    return sum8(total);
}

/* Up to three blocks of columns in a sweep of the rows from `source` to M on the variables K = k, k + 1.
 *
 * With M_KK - I in place of M_KK, H M_K: is I - H in the columns K, and these need no care: M_iK - M_iK (I - H) = M_iK
 * H. */
CORE_INLINE void pass(const Box *s, const real *source, const real *pivots, int k, int rows, int column, int blocks,
                      real h0, real h1, real h2)
{
    const int ld = s->ld;
    const real *const one = s->one + ld - k + column, *const x_row = pivots + column,
                      *const y_row = pivots + ld + column;
    real *const target = s->M;
    vec8 u[3], v[3];
    for (int b = 0; b < blocks; ++b) {
        const vec8 x = sub(load(x_row + 8 * b), load(one + 8 * b)), y = sub(load(y_row + 8 * b), load(one + 8 * b - 1));
        u[b] = plus_product(mul(y, splat(h1)), x, splat(h0));
        v[b] = plus_product(mul(y, splat(h2)), x, splat(h1));
    }
    for (int n = 2, i = k + 2; n < rows; ++n, ++i) { /* the rows of the next pair first, round to those before k */
        size_t at;
        vec8 f, g;
        i = i >= rows ? 0 : i;
        at = (size_t)i * (size_t)ld + (size_t)column;
        f = splat(pivots[i]);
        g = splat(pivots[ld + i]);
        for (int b = 0; b < blocks; ++b) {
            const vec8 from = load(source + at + 8 * b);
            store(target + at + 8 * b, less_product(less_product(from, f, u[b]), g, v[b]));
        }
    }
    for (int b = 0; b < blocks; ++b) {
        real *const to = target + (size_t)k * (size_t)ld + column + 8 * b;
        store(to, sub(u[b], load(one + 8 * b)));
        store(to + ld, sub(v[b], load(one + 8 * b - 1)));
    }
}

/* M = -P^-1; 0 where a pivot is not positive. */
static int sweep_all(Box *s)
{
    const int ld = s->ld, rows = (s->d + 1) / 2 * 2;
    const real *source = s->P;
    real aside[2 * 3 * LANES];
    int positive = 1;
    for (int k = 0; k < rows; k += 2) {
        const real *pivots = source + (size_t)k * (size_t)ld;
        const real a = pivots[k], b = pivots[k + 1], c = pivots[ld + k + 1], determinant = a * c - b * b;
        const real inverse = 1 / determinant, h0 = c * inverse, h1 = -b * inverse, h2 = a * inverse;
        int column = 0;
        positive &= (a > 0) & (determinant > 0);
        if (ld > 8 * PRODUCT_BLOCKS) { /* the first columns of the pivot rows are new before the last ones are done */
            real *const copy = ld > 3 * LANES ? s->pivots : aside; /* what fits aside leaves no trace in the state */
            memcpy(copy, pivots, 2 * (size_t)ld * sizeof(real));
            pivots = copy;
        }
        for (; PRODUCT_BLOCKS > 2 && column + 24 <= ld; column += 24) {
            pass(s, source, pivots, k, rows, column, 3, h0, h1, h2);
        }
        for (; PRODUCT_BLOCKS > 1 && column + 16 <= ld; column += 16) {
            pass(s, source, pivots, k, rows, column, 2, h0, h1, h2);
        }
        for (; column < ld; column += 8) {
            pass(s, source, pivots, k, rows, column, 1, h0, h1, h2);
        }
        source = s->M;
    }
    return positive;
}

/* Take P, its scale, a scaled copy and M; 0 where P is not finite, not symmetric to rounding or not safely positive
 * definite. */
int box_invert(Box *s, const real *P)
{
    const int d = s->d, ld = s->ld;
    vec8 longest = zeros();
    s->head->inverted = 0;
    if (d == 0 || !(MAGNITUDE(copy_scaled(s, P)) <= (real)d * (real)d * REAL_EPSILON / 2) || !sweep_all(s)) {
        return d == 0; /* nothing to invert */
    }
    for (int j = 0; j < d; ++j) {
        s->inverse_diagonal[j] = s->M[(size_t)j * (size_t)ld + (size_t)j];
    }
    for (int j = 0; j < ld; j += LANES) {
        const vec8 diagonal = sub(zeros(), load(s->inverse_diagonal + j));
        store(s->inverse_weight + j, over(splat(1), diagonal));
        longest = larger(longest, diagonal);
    }
    s->head->inverted = largest8(longest) <= LARGEST_INVERSE;
    return s->head->inverted;
}
