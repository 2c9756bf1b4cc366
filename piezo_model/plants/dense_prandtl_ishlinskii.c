/* The sum of many plays and creep operators, as of dense_prandtl_ishlinskii.py. */
#include "bindings_model.h"
#include "operators.h"

/* n thresholds r with the weights w_H of play and w_K of creep, and the gains of the creep rates of each. */
typedef struct {
    int64_t n, rates;
    const double *r, *w_H, *w_K, *gain;
} Dense;

static void plays_and_creep(const Dense *p, int64_t samples, const double *u, double *z_play, double *z_creep,
                            double *before, double *total)
{
    for (int64_t k = 0; k < samples; ++k) {
        total[k] = 0;
        for (int64_t i = 0; i < p->n; ++i) {
            double creep = 0;
            z_play[i] = play_of(u[k], p->r[i], z_play[i]);
            for (int64_t j = 0; j < p->rates; ++j) {
                double *const z = z_creep + i * p->rates + j;
                *z = creep_of(*before, p->r[i], p->gain[j], *z);
                creep += *z;
            }
            total[k] += p->w_H[i] * z_play[i] + p->w_K[i] * creep / (double)p->rates;
        }
        *before = u[k];
    }
}

#define BINDINGS(F)                                                                                                    \
    F(plays_and_creep, "u[n], r[i], w_H[i], w_K[i], a[j], z_play[i]=, z_creep[i,j]=, u_previous[1]=, total[n]=",       \
      "their weighted sum along u.", SAMPLES_LAST,                                                                     \
      plays_and_creep(&(Dense){LENGTH(i), LENGTH(j), REALS(1), REALS(2), REALS(3), REALS(4)}, LENGTH(n), REALS(0),     \
                      REALS(5), REALS(6), REALS(7), REALS(8)))
MAKE_BINDINGS(dense)
