/* The sweep of a symmetric matrix on one variable, with p = M_jj:
 *
 *     M <- M - M_j M_j'/p  off row and column j,    M_j <- M_j/|p|,    M_jj <- -1/p.
 *
 * Swept on j once more it is what it was.
 *
 * Source: J. H. Goodnight, "A tutorial on the SWEEP operator", American Statistician 33 (1979) 149.
 */
#ifndef CORE_SWEEP_H
#define CORE_SWEEP_H

#include "vec8.h"

/* M has so many rows of ld numbers, and u has room for one. */
CORE_INLINE void sweep(real *M, int rows, int ld, int j, real *u)
{
    real *const row = M + (size_t)j * (size_t)ld;
    const real inverse = 1 / row[j], size = MAGNITUDE(inverse);
    for (int b = 0; b < ld; b += LANES) {
        store(u + b, load(row + b));
        store(row + b, zeros());
    }
    for (int i = 0; i < rows; ++i) {
        real *const of_M = M + (size_t)i * (size_t)ld;
        const vec8 factor = splat(i == j ? size : -u[i] * inverse);
        for (int b = 0; b < ld; b += LANES) {
            store(of_M + b, plus_product(load(of_M + b), factor, load(u + b)));
        }
        of_M[j] = i == j ? -inverse : u[i] * size;
    }
}

#endif
