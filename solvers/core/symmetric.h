/* The symmetric part of S P S, S diagonal, for a P of which nothing is known. */
#ifndef CORE_SYMMETRIC_H
#define CORE_SYMMETRIC_H

#include "status.h"
#include "vec8.h"

#define ASYMMETRIC_SHARE ((real)1e-9) /* of sqrt(P_ii P_jj) */

/* From P (d, d) to `out`, d rows of ld numbers; OK, NOT_FINITE, INDEFINITE where P_jj < 0, or ASYMMETRIC. */
CORE_INLINE int scaled_symmetric(const real *P, int d, int ld, const real *scale, real *out)
{
    int infinite = 0, negative = 0, asymmetric = 0;
    for (int i = 0; i < d; ++i) {
        for (int j = 0; j <= i; ++j) {
            const real factor = scale[i] * scale[j], a = P[i * d + j] * factor, b = P[j * d + i] * factor;
            out[i * ld + j] = out[j * ld + i] = (a + b) / 2;
            infinite |= !(MAGNITUDE(a) < REAL_INFINITY && MAGNITUDE(b) < REAL_INFINITY);
        }
        negative |= out[i * ld + i] < 0;
        for (int j = 0; j < i && !negative; ++j) {
            const real apart = MAGNITUDE(P[i * d + j] - P[j * d + i]) * (scale[i] * scale[j]);
            asymmetric |= apart > ASYMMETRIC_SHARE * ROOT(out[i * ld + i]) * ROOT(out[j * ld + j]);
        }
    }
    return infinite ? NOT_FINITE : negative ? INDEFINITE : asymmetric ? ASYMMETRIC : OK;
}

#endif
