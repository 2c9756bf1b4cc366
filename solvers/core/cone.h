/* The exact Euclidean projection onto {x : A x <= b} of some of the variables of a problem. */
#ifndef CORE_CONE_H
#define CORE_CONE_H

#include "box.h"

enum { CONE_KIND = 0x434f4e31 };

typedef struct {
    int32_t kind, d; /* d: how many of all variables are coupled by the rows */
    int64_t bytes;
    int32_t rows;
} ConeHead;

typedef struct {
    ConeHead *head;
    int rows, coupled;
    real *A, *b;    /* (rows, coupled), of length one each; (rows) */
    real *slack, *zero; /* b - A v, the linear term of the dual; its lower bounds */
    int32_t *index; /* the coupled variables */
    Box dual;       /* its answer holds the multipliers */
} Cone;

CORE_API int64_t cone_bytes(int rows, int coupled);
CORE_API Cone cone_at(void *memory);
/* Make a block of cone_bytes(rows, coupled) bytes a state; a status of box_take. */
CORE_API int cone_setup(void *memory, int rows, int coupled, const real *A, const real *b, const int64_t *index);
/* Move the coupled entries of x to their projection, warm from the one before; OK, or UNBOUNDED where there is no feasible point. */
CORE_API int cone_project(Cone *s, real *x);

#endif
