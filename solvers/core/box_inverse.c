/* P^-1 of the scaled data of a box problem, by sweeps on two variables at a time.
 *
 * Swept on the variables F, with R the others, P becomes the symmetric matrix M with
 *
 *     M_FF = -P_FF^-1,    M_FR = P_FF^-1 P_FR,    M_RR = P_RR - P_RF P_FF^-1 P_FR,
 *
 * and sweeping two more, K in R, with H = M_KK^-1 and N all but K, is
 *
 *     M_NN <- M_NN - M_NK H M_KN,    M_KN <- H M_KN,    M_KK <- -H.
 *
 * Swept on all variables, M = -P^-1. P is positive definite iff every H on the way is, and 1/lambda_min(P) <= trace
 * P^-1, which a triangular factor does not give; box_data.c treats a P that does not safely pass both tests. Two pivots
 * per pass halve the loads and stores of M.
 *
 * Sources: A. E. Beaton, The use of special matrix operators in statistical calculus, ETS RB-64-51, 1964; J. H.
 * Goodnight, "A tutorial on the SWEEP operator", American Statistician 33 (1979) 149.
 */
#include "box.h"

enum { FEW = 24 }; /* longest row whose length is a compile-time constant */
/* Largest diagonal entry of P^-1, at unit diagonal of P, for which two steps of refinement make an answer exact. */
#define LARGEST_INVERSE ((real)1e9)

/* Scale P and copy S P S by rows; v'(S P S)w - w'(S P S)v, which for irregular v and w is zero to rounding if P is
 * symmetric, and NaN if an entry is not finite. */
CORE_INLINE real copy_scaled(Box *s, const real *P, int ld)
{
    const int d = s->d, last = ld - LANES;
    vec8 skew = zeros();
    for (int j = 0; j < ld; ++j) {
        s->scale[j] = j < d ? P[(size_t)j * (size_t)d + (size_t)j] : 1;
    }
    for (int j = 0; j < ld; j += LANES) {
        store(s->scale + j, root_scale(load(s->scale + j)));
    }
    for (int i = 0; i < d; ++i) {
        const real *const row = P + (size_t)i * (size_t)d;
        const vec8 scale = splat(s->scale[i]);
        vec8 along_v = zeros(), along_w = zeros();
        for (int j = 0; j < ld; j += LANES) {
            const vec8 given = j < last ? load(row + j) : load_first(row + j, d - j);
            const vec8 entries = mul(given, mul(scale, load(s->scale + j)));
            store(s->P + (size_t)i * (size_t)ld + j, entries);
            along_v = plus_product(along_v, entries, load(s->v + j));
            along_w = plus_product(along_w, entries, load(s->w + j));
        }
        skew = sub_mul(plus_product(skew, along_w, splat(s->v[i])), along_v, splat(s->w[i]));
    }
    return sum8(skew);
}

/* Beginning of the part of row i that is swept: the diagonal block of long rows, since the part before it follows from
 * symmetry; short rows are faster swept as a whole. */
CORE_INLINE int swept_from(int i, int ld) { return ld <= FEW ? 0 : i / LANES * LANES; }

/* M_N <- M_N - M_Nk u - M'_Nm v, for two rows i, i + 1 of N; the columns M_Nk and M'_Nm are the rows x and y. */
CORE_INLINE void reduce_rows(const Box *s, const real *from, const real *x, const real *y, const real *u, int i, int ld)
{
    const real *const v = u + ld, *const row = from + (size_t)i * (size_t)ld;
    const vec8 x0 = splat(x[i]), y0 = splat(y[i]), x1 = splat(x[i + 1]), y1 = splat(y[i + 1]);
    real *const to = s->M + (size_t)i * (size_t)ld;
    for (int b = swept_from(i, ld); b < ld; b += LANES) {
        const vec8 ub = load(u + b), vb = load(v + b);
        store(to + b, sub_mul(sub_mul(load(row + b), x0, ub), y0, vb));
        store(to + ld + b, sub_mul(sub_mul(load(row + ld + b), x1, ub), y1, vb));
    }
}

/* Rows k and k + 1, whole. */
CORE_INLINE const real *whole_pair(const Box *s, const real *from, int k, int ld)
{
    const int begin = swept_from(k, ld);
    const real *const first = from + (size_t)k * (size_t)ld;
    real *const pair = s->pair + 2 * ld;
    if (begin == 0) {
        return first;
    }
    for (int j = 0; j < begin; ++j) {
        const real *const column = from + (size_t)j * (size_t)ld + k;
        pair[j] = column[0];
        pair[ld + j] = column[1];
    }
    for (int j = begin; j < ld; j += LANES) {
        store(pair + j, load(first + j));
        store(pair + ld + j, load(first + ld + j));
    }
    return pair;
}

/* Sweep the matrix at `from` to M on the variables k and m = k + 1; whether M_KK is positive definite.
 *
 * That is two sweeps of one variable, with L = M_mk/M_kk and M'_m = M_m - L M_k the row that the first leaves to the
 * second, whose pivot is M'_mm = det M_KK/M_kk. With M_KK - I in place of M_KK the columns K need no care. */
CORE_INLINE int sweep_pair(const Box *s, const real *from, int k, int ld)
{
    const int rows = (s->d + 1) / 2 * 2;
    const real *const first = whole_pair(s, from, k, ld), *const second = first + ld;
    const real a = first[k], b = first[k + 1], c = second[k + 1], determinant = a * c - b * b, inverse_a = 1 / a;
    const real of_second = a * (1 / determinant), ratio = b * inverse_a;
    const vec8 inverse_k = splat(inverse_a), inverse_m = splat(of_second), L = splat(ratio);
    real few[3 * FEW]; /* stays in registers */
    real *const u = ld <= FEW ? few : s->pair, *const v = u + ld,
                *const reduced = ld <= FEW ? v + ld : s->pair + 4 * ld;
    real *const to = s->M + (size_t)k * (size_t)ld;
    for (int j = 0; j < ld; j += LANES) {
        const vec8 x = sub(load(first + j), with_lane(zeros(), k - j, 1));
        const vec8 y = sub_mul(sub(load(second + j), with_lane(zeros(), k + 1 - j, 1)), L, x);
        store(reduced + j, y);
        store(u + j, mul(x, inverse_k));
        store(v + j, mul(y, inverse_m));
    }
    for (int i = k + 2; i < rows; i += 2) { /* the next pair first: its division need not wait for the others */
        reduce_rows(s, from, first, reduced, u, i, ld);
    }
    for (int i = 0; i < k; i += 2) {
        reduce_rows(s, from, first, reduced, u, i, ld);
    }
    for (int j = swept_from(k, ld); j < ld; j += LANES) {
        store(to + j, sub(sub_mul(load(u + j), L, load(v + j)), with_lane(zeros(), k - j, 1)));
        store(to + ld + j, sub(load(v + j), with_lane(zeros(), k + 1 - j, 1)));
    }
    return (a > 0) & (determinant > 0);
}

CORE_INLINE int invert_scaled(Box *s, const real *P, int ld)
{
    const int d = s->d;
    const real *from = s->P;
    vec8 longest = zeros();
    int positive = P == NULL || MAGNITUDE(copy_scaled(s, P, ld)) <= (real)d * (real)d * REAL_EPSILON;
    for (int k = 0; positive && k < d; k += 2) {
        positive = sweep_pair(s, from, k, ld);
        from = s->M;
    }
    for (int i = 0; i < d; ++i) {
        for (int j = 0; j < swept_from(i, ld); ++j) {
            s->M[(size_t)i * (size_t)ld + (size_t)j] = s->M[(size_t)j * (size_t)ld + (size_t)i];
        }
    }
    for (int j = 0; j < d; ++j) {
        s->inverse_diagonal[j] = s->M[(size_t)j * (size_t)ld + (size_t)j];
    }
    for (int j = 0; j < ld; j += LANES) {
        longest = maximum(longest, magnitude(load(s->inverse_diagonal + j)));
    }
    return positive && largest8(longest) <= LARGEST_INVERSE;
}

/* For few variables, the length of the rows is a compile-time constant. */
int box_invert(Box *s, const real *P)
{
    return s->ld == 8 ? invert_scaled(s, P, 8) : s->ld == FEW ? invert_scaled(s, P, FEW) : invert_scaled(s, P, s->ld);
}
