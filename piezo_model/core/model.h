/* The modified Prandtl-Ishlinskii model with creep, equation (2), in unit amplitudes:
 *
 *     y = S[ H[x] + K[x] + offset ],   H[x] = sum of w_Hi H_ri[x],   K[x] = sum of w_Ki K_ri[x]
 *
 * Source: K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_MODEL_H
#define CORE_MODEL_H

#include "operators.h"

enum { MODEL_KIND = 0x4d4f4431 };

typedef struct {
    ShapedHead shaped;
    real offset;
} ModelHead;

typedef struct {
    ModelHead *head;
    Shape shape;
    Operators operators;
    Superposition S;
    real *w_H, *w_K; /* lanes, creep_lanes */
} Model;

CORE_API int64_t model_bytes(Shape shape);
CORE_API Model model_at(void *memory);
/* Make a block of model_bytes(shape) bytes a model; its vectors are still to be written. */
CORE_API Model model_setup(void *memory, Shape shape, real offset);
/* Outputs at the samples x; moves the states play (lanes) and creep (creep_lanes) on. */
CORE_API void model_simulate(const Model *m, const real *x, int64_t count, real *play, real *creep, real *y);

#endif
