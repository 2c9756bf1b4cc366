#ifndef CORE_EIGENVALUE_H
#define CORE_EIGENVALUE_H

#include "vec8.h"

/* An upper bound of the largest eigenvalue, closer than a thousandth if that is positive, of the symmetric matrix A, d
 * rows of ld numbers; 0 for d = 0. Only the lower triangle of A is read, and it is overwritten. `diagonal` and `beside`
 * are scratch memory of d numbers each. `below` is set to 1 if an eigenvalue is less than -relative times the largest,
 * else to 0. */
CORE_API real largest_eigenvalue(real *A, int ld, int d, real *diagonal, real *beside, real relative, int *below);

#endif
