/* The sum over lines of relays, as of relay_preisach.py: each is a play and the distribution function of its line. */
#include "bindings_model.h"
#include "operators.h"

typedef struct {
    int n;
    const double *r, *c, *sigma, *gain;
    double shift;
} Lines;

static void relay_lines(const Lines *p, int64_t samples, const double *u, double *z, double *total)
{
    for (int64_t k = 0; k < samples; ++k) {
        total[k] = -p->shift;
        for (int i = 0; i < p->n; ++i) {
            z[i] = play_of(u[k], p->r[i], z[i]);
            const double t = (z[i] - p->c[i]) / p->sigma[i];
            total[k] += p->gain[i] * t / sqrt(1 + t * t);
        }
    }
}

#define BINDINGS(F)                                                                                                    \
    F(relay_lines,                                                                                                     \
      "u[n], r[i], c[i], sigma[i], gain[i], shift, z[i]=, total[n]=", "sum over lines of relays along u.",             \
      SAMPLES_LAST,                                                                                                    \
      relay_lines(&(Lines){SIZE(i), REALS(1), REALS(2), REALS(3), REALS(4), NUMBER(5)}, LENGTH(n), REALS(0), REALS(6), \
                  REALS(7)))
MAKE_BINDINGS(relay_preisach)
