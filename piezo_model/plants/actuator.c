/* Creep that grows like log t, as of actuator.py. */
#include "bindings_model.h"
#include "operators.h"

static void log_creep(int64_t samples, int64_t states, const double *u, const double *gain, double *z, double *before,
                      double *K)
{
    for (int64_t k = 0; k < samples; ++k) {
        K[k] = 0;
        for (int64_t j = 0; j < states; ++j) {
            z[j] = creep_step(*before, 0, gain[j], z[j]);
            K[k] += z[j];
        }
        K[k] /= (double)states;
        *before = u[k];
    }
}

#define BINDINGS(F)                                                                                                    \
    F(log_creep, "u[n], a[j], z[j]=, u_previous[1]=, K[n]=", "creep of an actuator.", SAMPLES_LAST,                    \
      log_creep(LENGTH(n), LENGTH(j), REALS(0), REALS(1), REALS(2), REALS(3), REALS(4)))
MAKE_BINDINGS(actuator)
