/* The largest eigenvalue of a symmetric matrix by Householder tridiagonalisation and bisection on Sturm counts.
 *
 * A reflection H = I - u u'/h with u = row i of A left of the diagonal, its last entry lengthened by s = -sign |u|,
 * gives A <- A - w u' - u w', w = p - (u'p / 2h) u, p = A u / h. With T tridiagonal, diagonal a and beside it b, the
 * pivots of T - x I,
 *
 *     t_1 = a_1 - x,    t_i = a_i - x - b_i^2 / t_(i-1),
 *
 * include as many negatives as T has eigenvalues below x. Bisection from Gershgorin's bound halves the interval until
 * its ends are `apart` from each other, relative to the upper one, which no eigenvalue exceeds: a step length needs no
 * more.
 *
 * Sources: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., sections 8.3.1 and 8.4.1.
 */
#include "eigenvalue.h"

static void tridiagonal(real *A, int ld, int d, real *diagonal, real *beside)
{
    for (int i = d - 1; i > 0; --i) {
        real *const u = A + (size_t)i * (size_t)ld;
        real square = 0, length, h, half = 0;
        for (int k = 0; k < i; ++k) {
            square += u[k] * u[k];
        }
        diagonal[i] = u[i];
        length = ROOT(square);
        beside[i] = u[i - 1] > 0 ? -length : length;
        if (!(square > 0)) {
            continue;
        }
        h = square - u[i - 1] * beside[i];
        u[i - 1] -= beside[i];
        for (int j = 0; j < i; ++j) { /* diagonal holds p, then w, in its entries that are not final */
            real total = 0;
            for (int k = 0; k <= j; ++k) {
                total += A[(size_t)j * (size_t)ld + (size_t)k] * u[k];
            }
            for (int k = j + 1; k < i; ++k) {
                total += A[(size_t)k * (size_t)ld + (size_t)j] * u[k];
            }
            diagonal[j] = total / h;
            half += diagonal[j] * u[j];
        }
        half = half / (h + h);
        for (int j = 0; j < i; ++j) {
            diagonal[j] -= half * u[j];
            for (int k = 0; k <= j; ++k) {
                A[(size_t)j * (size_t)ld + (size_t)k] -= diagonal[j] * u[k] + u[j] * diagonal[k];
            }
        }
    }
    diagonal[0] = A[0];
    beside[0] = 0;
}

/* Number of eigenvalues below x. */
static int count_below(const real *diagonal, const real *beside, int d, real x, real tiny)
{
    int count = 0;
    real pivot = 1;
    for (int i = 0; i < d; ++i) {
        pivot = diagonal[i] - x - beside[i] * beside[i] / pivot;
        pivot = MAGNITUDE(pivot) < tiny ? -tiny : pivot;
        count += pivot < 0;
    }
    return count;
}

/* Divide A by the power of two below its largest entry, so that no square overflows or underflows; the power. */
static real normalise(real *A, int ld, int d)
{
    real largest = 0;
    for (int i = 0; i < d; ++i) {
        for (int j = 0; j <= i; ++j) {
            const real size = MAGNITUDE(A[(size_t)i * (size_t)ld + (size_t)j]);
            largest = size > largest ? size : largest;
        }
    }
    const real power = power_below(largest);
    for (int i = 0; i < d; ++i) {
        for (int j = 0; j <= i; ++j) {
            A[(size_t)i * (size_t)ld + (size_t)j] /= power;
        }
    }
    return power;
}

real largest_eigenvalue(real *A, int ld, int d, real *diagonal, real *beside, real relative, int *below)
{
    const real apart = (real)1e-3;
    real low = -REAL_INFINITY, high = -REAL_INFINITY, size = 0, tiny, power;
    *below = 0;
    if (d == 0) {
        return 0;
    }
    power = normalise(A, ld, d);
    tridiagonal(A, ld, d, diagonal, beside);
    for (int i = 0; i < d; ++i) {
        const real next = i + 1 < d ? MAGNITUDE(beside[i + 1]) : 0, reach = MAGNITUDE(beside[i]) + next;
        low = diagonal[i] > low ? diagonal[i] : low; /* the largest eigenvalue is no less than any diagonal entry */
        high = diagonal[i] + reach > high ? diagonal[i] + reach : high;
        size = MAGNITUDE(diagonal[i]) + reach > size ? MAGNITUDE(diagonal[i]) + reach : size;
    }
    tiny = size * REAL_EPSILON * REAL_EPSILON;
    if (!(tiny > 0)) {
        return high * power;
    }
    for (;;) {
        const real middle = low + (high - low) / 2;
        if (high - low <= apart * MAGNITUDE(high) || !(low < middle && middle < high)) {
            break;
        }
        if (count_below(diagonal, beside, d, middle, tiny) == d) {
            high = middle;
        } else {
            low = middle;
        }
    }
    *below = count_below(diagonal, beside, d, -relative * MAGNITUDE(high), tiny) > 0;
    return high * power;
}
