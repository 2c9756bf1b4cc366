/* The data basis of the identification: the Gram matrix of the rows (x, Xi), accumulated sample by sample,
 *
 *     gram = sum of lambda^(N-k) row_k row_k',   lambda <= 1.
 *
 * Rows are added in blocks of a fixed size counted from the first sample, so that the result does not depend on how the
 * samples are cut into chunks.
 *
 * Source: the paper's equations (3) to (6).
 */
#ifndef CORE_DATA_BASIS_H
#define CORE_DATA_BASIS_H

#include "regressors.h"

enum { BASIS_KIND = 0x42415331 };
enum { BASIS_BLOCK = 64 }; /* rows added at a time; few enough for the first-level cache */

typedef struct {
    ShapedHead shaped;
    real forgetting;         /* lambda */
    int64_t filled, samples; /* rows of the unfinished block; samples counted */
} BasisHead;

typedef struct {
    BasisHead *head;
    Shape shape;
    Regressors regressors;
    real *play, *creep; /* states before the next sample */
    real *rows;         /* BASIS_BLOCK of row_nums numbers */
    real *gram;         /* symmetric_nums(row_width), upper triangle */
} Basis;

CORE_API int64_t basis_bytes(Shape shape);
CORE_API Basis basis_at(void *memory);
/* Initialise basis_bytes(shape) bytes; the caller sets the parameters and states. */
CORE_API void basis_setup(void *memory, Shape shape, real forgetting);
/* Add one sample in normalised units. */
CORE_API void basis_count(Basis *b, real x, real y);
/* End a block: gram <- lambda^filled gram + sum of lambda^(filled-1-k) row_k row_k'. */
CORE_API void basis_finish(Basis *b);

#endif
