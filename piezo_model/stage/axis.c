/* Lever and structure of an axis, as of axis.py: the exact answer of a damped oscillator to forces that are held. */
#include "bindings_model.h"

static void structure_response(const double *F, int64_t samples, const double *f, double *s, double *z)
{
    for (int64_t k = 0; k < samples; ++k) {
        const double deviation = s[0] - f[k], speed = s[1];
        s[0] = f[k] + F[0] * deviation + F[1] * speed;
        s[1] = F[2] * deviation + F[3] * speed;
        z[k] = s[0];
    }
}

#define BINDINGS(F)                                                                                                    \
    F(structure_response, "f[n], F[2,2], s[2]=, z[n]=", "positions while forces are held.", SAMPLES_LAST,              \
      structure_response(REALS(1), LENGTH(n), REALS(0), REALS(2), REALS(3)))
MAKE_BINDINGS(axis)
