/* Elementary operators and the model as Python calls them. */
#include "bindings_model.h"
#include "model.h"

static void plays(int64_t samples, int n, const double *x, const double *r, double *z, double *out)
{
    for (int64_t k = 0; k < samples; ++k) {
        for (int i = 0; i < n; ++i) {
            z[i] = out[k * n + i] = play_step(x[k], r[i], z[i]);
        }
    }
}

static void creeps(int64_t samples, int n, const double *x, const double *r, const double *gain, double *z, double *out)
{
    for (int64_t k = 0; k < samples; ++k) {
        for (int i = 0; i < n; ++i) {
            out[k * n + i] = z[i];
            z[i] = creep_step(x[k], r[i], gain[i], z[i]);
        }
    }
}

static void dead_zones(int64_t samples, int n, const double *u, const double *low, const double *high, double *out)
{
    for (int64_t k = 0; k < samples; ++k) {
        for (int i = 0; i < n; ++i) {
            out[k * n + i] = dead_zone_step(u[k], low[i], high[i]);
        }
    }
}

/* Its padding has no weight, so that it may count. */
#define MODEL                                                                                                          \
    ((Model){{SIZE(l) - 1, SIZE(z), SIZE(m), 0},                                                                       \
             {REALS(0), REALS(1)},                                                                                     \
             {REALS(2), REALS(3), REALS(4)},                                                                           \
             REALS(5),                                                                                                 \
             REALS(6),                                                                                                 \
             NUMBER(7)})
#define BINDINGS(F)                                                                                                    \
    F(play, "x[n], r[i], z[i]=, out[n,i]=", "play operators over samples; z moves on.", SAMPLES_LAST,                  \
      plays(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3)))                                               \
    F(creep, "x[n], r[i], a[i], z[i]=, out[n,i]=", "creep operators over samples; z moves on.", SAMPLES_LAST,          \
      creeps(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3), REALS(4)))                                    \
    F(dead_zone, "u[n], low[i], high[i], out[n,i]=", "dead zones over samples.", SAMPLES_LAST,                         \
      dead_zones(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3)))                                          \
    F(model_simulate,                                                                                                  \
      "r[l], a[m], low[z], high[z], w_S[z], w_H[l], w_K[c], constant, play[l]=, creep[c]=, x[n], y[n]=",               \
      "outputs of a model for inputs; the states move on.",                                                            \
      (NEED_SIZE(l, padded(SIZE(l))), NEED_SIZE(z, padded(SIZE(z))), NEED_SIZE(c, LENGTH(m) * LENGTH(l)),              \
       SAMPLES_LAST),                                                                                                  \
      model_simulate(&MODEL, REALS(10), LENGTH(n), REALS(8), REALS(9), REALS(11)))
MAKE_BINDINGS(model)
