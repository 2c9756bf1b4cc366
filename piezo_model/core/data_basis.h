/* The data basis of the identification: the Gram matrix of the rows (x, Xi), accumulated while the samples stream by,
 *
 *     gram = sum of lambda^(N-k) row_k row_k',   lambda <= 1.
 *
 * Rows are gathered in blocks of fixed size counted from the first sample, so that the same samples give
 * the same bits in whatever chunks they come.
 *
 * Source: the paper's equations (3) to (6).
 */
#ifndef CORE_DATA_BASIS_H
#define CORE_DATA_BASIS_H

#include "regressors.h"

enum { BASIS_KIND = 0x42415331 };
enum { BASIS_BLOCK = 64 }; /* rows gathered before they are added, few enough to stay in the first-level cache */

typedef struct {
    ShapedHead shaped;
    real forgetting;         /* lambda */
    int64_t filled, samples; /* rows that wait for their block to be full; samples counted */
} BasisHead;

enum { X_MIN, X_MAX, Y_MIN, Y_MAX }; /* of the span */

typedef struct {
    BasisHead *head;
    Shape shape;
    Regressors regressors;
    real *play, *creep;             /* states before the coming sample */
    real *start_play, *start_creep; /* at the first counted sample */
    real *span;                     /* lowest and highest x, lowest and highest y */
    real *rows;                     /* BASIS_BLOCK of row_nums numbers */
    real *gram;                     /* symmetric_nums(row_width); the upper triangle counts */
} Basis;

CORE_API int64_t basis_bytes(Shape shape);
CORE_API Basis basis_at(void *memory);
/* Make a block of basis_bytes(shape) bytes a data basis; parameters and states are still to be written. */
CORE_API void basis_setup(void *memory, Shape shape, real forgetting);
/* Count one sample in unit amplitudes. */
CORE_API void basis_count(Basis *b, real x, real y);
/* gram <- lambda^count gram + the last `count` rows; the rows are room for their weighted copies. */
CORE_API void basis_add_rows(Shape s, real *rows, int count, real forgetting, real *gram);

#endif
