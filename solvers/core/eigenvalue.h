#ifndef CORE_EIGENVALUE_H
#define CORE_EIGENVALUE_H

#include "vec8.h"

/* The largest eigenvalue, to rounding, of the symmetric matrix A: d rows of ld numbers, of which the lower triangle is
 * read and destroyed; 0 for d = 0. `diagonal` and `beside` are room for d numbers each. `below` becomes 1 where an
 * eigenvalue lies below -share times the largest, else 0. */
CORE_API real largest_eigenvalue(real *A, int ld, int d, real *diagonal, real *beside, real share, int *below);

#endif
