/* w <- clip(w - (M w + c)) with M = eta P and c = eta q. */
#include <math.h>
#include <stddef.h>

#include "embedded.h"

#define MOST_PRODUCTS 1000

/* Rows are padded with zeros to blocks of eight, and their number to an even one. */
enum { LANES = (D + 7) / 8 * 8, EVEN = (D + 1) / 2 * 2 };

static double M[EVEN][LANES], c[LANES], w[LANES], lower[LANES], upper[LANES], ratio, step;
static long steps;

void embedded_setup(const double *lb, const double *ub, const double *settings)
{
    steps = (long)settings[0];
    ratio = settings[1];
    for (int i = 0; i < D; ++i) {
        lower[i] = lb[i];
        upper[i] = ub[i];
    }
}

/* product = P v; P is symmetric. */
static void multiply(const double *P, const double *v, double *product)
{
    for (int i = 0; i < D; ++i) {
        product[i] = 0;
    }
    for (int j = 0; j < D; ++j) {
        for (int i = 0; i < D; ++i) {
            product[i] += P[j * D + i] * v[j];
        }
    }
}

/* The power method; the root of the sum of squares makes a vector of length 1. */
static double largest_eigenvalue(const double *P)
{
    double v[D], next[D], found = 0;
    for (int i = 0; i < D; ++i) {
        v[i] = 1 + 0.01 * i;
    }
    for (int k = 0; k < MOST_PRODUCTS; ++k) {
        double square = 0, before = found;
        multiply(P, v, next);
        for (int i = 0; i < D; ++i) {
            square += next[i] * next[i];
        }
        if (!(square > 0)) {
            return 0;
        }
        const double length = sqrt(square);
        for (int i = 0; i < D; ++i) {
            v[i] = next[i] / length;
        }
        found = length;
        if (k > 10 && fabs(found - before) <= 1e-8 * found) {
            break;
        }
    }
    return found;
}

void embedded_update(const double *P, const double *q)
{
    const double largest = largest_eigenvalue(P);
    step = largest > 0 ? 2 * ratio / largest : 1;
    for (int i = 0; i < D; ++i) {
        c[i] = step * q[i];
        for (int j = 0; j < D; ++j) {
            M[i][j] = step * P[i * D + j];
        }
    }
}

int embedded_solve(const double *start)
{
    for (int i = 0; i < D; ++i) {
        w[i] = fmax(lower[i], fmin(upper[i], start ? start[i] : 0));
    }
    for (long k = 0; k < steps; ++k) {
        /* Two sums, so that one product does not wait for the one before. */
        double even[LANES], odd[LANES];
        for (int i = 0; i < LANES; ++i) {
            even[i] = w[i] - c[i];
            odd[i] = 0;
        }
        for (int j = 0; j < EVEN; j += 2) {
            for (int i = 0; i < LANES; ++i) {
                even[i] -= M[j][i] * w[j];
                odd[i] -= M[j + 1][i] * w[j + 1];
            }
        }
        for (int i = 0; i < LANES; ++i) {
            const double next = even[i] + odd[i];
            const double at_least = next < lower[i] ? lower[i] : next;
            w[i] = at_least > upper[i] ? upper[i] : at_least;
        }
    }
    return 0;
}

void embedded_answer(double *x, double *z)
{
    for (int i = 0; i < D; ++i) {
        double g = c[i];
        for (int j = 0; j < D; ++j) {
            g += M[j][i] * w[j];
        }
        g /= step;
        x[i] = w[i];
        z[i] = w[i] <= lower[i] ? -fmax(g, lower[i] >= upper[i] ? g : 0) : w[i] >= upper[i] ? -fmin(g, 0) : 0;
    }
}

const char *embedded_status(void) { return "all steps taken"; }

int embedded_iterations(void) { return (int)steps; }
