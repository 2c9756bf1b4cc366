/* The modified Prandtl-Ishlinskii model with creep, equation (2), in normalised units:
 *
 *     y = S[ H[x] + K[x] + offset ],   H[x] = sum of w_Hi H_ri[x],   K[x] = sum of w_Ki K_ri[x]
 *
 * Source: K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_MODEL_H
#define CORE_MODEL_H

#include "operators.h"

typedef struct {
    Shape shape;
    Operators operators;
    const real *low, *high, *w_S; /* dead zones of S, zone_lanes */
    const real *w_H, *w_K;        /* lanes, creep_lanes */
    real offset;
} Model;

/* Outputs for the samples x; advances the states play (lanes) and creep (creep_lanes). */
CORE_API void model_simulate(const Model *m, const real *x, int64_t count, real *play, real *creep, real *y);

#endif
