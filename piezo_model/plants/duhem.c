/* The deviation of the Duhem actuator along a path, as of duhem.py. */
#include "bindings_model.h"

#include <math.h>

static void deviation(double alpha, double b, int64_t samples, const double *u, double *e, double *before, double *path)
{
    for (int64_t k = 0; k < samples; ++k) {
        const double move = u[k] - *before, goal = -copysign(1 - b, move) / alpha;
        *e = goal + (*e - goal) * exp(-alpha * fabs(move));
        *before = u[k];
        path[k] = *e;
    }
}

#define BINDINGS(F)                                                                                                    \
    F(deviation, "u[n], alpha, b, e[1]=, u_before[1]=, path[n]=", "deviation along u.", SAMPLES_LAST,                  \
      deviation(NUMBER(1), NUMBER(2), LENGTH(n), REALS(0), REALS(3), REALS(4), REALS(5)))
MAKE_BINDINGS(duhem)
