/* Elementary operators and the model as Python calls them. */
#include "bindings_model.h"
#include "model.h"

static void plays(int64_t samples, int n, const double *x, const double *r, double *z, double *out)
{
    for (int64_t k = 0; k < samples; ++k) {
        for (int i = 0; i < n; ++i) {
            z[i] = out[k * n + i] = play_of(x[k], r[i], z[i]);
        }
    }
}

static void creeps(int64_t samples, int n, const double *x, const double *r, const double *gain, double *z, double *out)
{
    for (int64_t k = 0; k < samples; ++k) {
        for (int i = 0; i < n; ++i) {
            out[k * n + i] = z[i];
            z[i] = creep_of(x[k], r[i], gain[i], z[i]);
        }
    }
}

/* The padding of n + 1 thresholds counts as thresholds of weight zero. */
#define MODEL                                                                                                          \
    ((Model){{SIZE(l) - 1, SIZE(z), SIZE(m), 0},                                                                       \
             {REALS(0), REALS(1)},                                                                                     \
             REALS(2),                                                                                                 \
             REALS(3),                                                                                                 \
             REALS(4),                                                                                                 \
             REALS(5),                                                                                                 \
             REALS(6),                                                                                                 \
             NUMBER(7)})
#define BINDINGS(F)                                                                                                    \
    F(play, "x[n], r[i], z[i]=, out[n,i]=", "outputs of play operators; advances z.", SAMPLES_LAST,                    \
      plays(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3)))                                               \
    F(creep, "x[n], r[i], a[i], z[i]=, out[n,i]=", "outputs of creep operators; advances z.", SAMPLES_LAST,            \
      creeps(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3), REALS(4)))                                    \
    F(model_simulate,                                                                                                  \
      "r[l], a[m], low[z], high[z], w_S[z], w_H[l], w_K[c], constant, play[l]=, creep[c]=, x[n], y[n]=",               \
      "outputs of a model for inputs; advances the states.",                                                           \
      (NEED_SIZE(l, padded(SIZE(l))), NEED_SIZE(z, padded(SIZE(z))), NEED_SIZE(c, LENGTH(m) * LENGTH(l)),              \
       SAMPLES_LAST),                                                                                                  \
      model_simulate(&MODEL, REALS(10), LENGTH(n), REALS(8), REALS(9), REALS(11)))
MAKE_BINDINGS(model)
