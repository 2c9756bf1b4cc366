#ifndef CORE_FORGETTING_H
#define CORE_FORGETTING_H

#include "vec8.h"

/* Update P (d, d), q (d) and c by one row (xi, x) of d + 1 numbers; see forgetting.c. */
CORE_API void absorb(real *P, real *q, real *c, int d, const real *row, real forgetting);

#endif
