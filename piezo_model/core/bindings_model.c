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

#define TAPS(zeros, poles) ((zeros) > (poles) ? (zeros) : (poles))
/* Add to y what b(z) / a(z) with a_0 = 1 makes of the columns of x, balanced before them. In transposed direct form II,
 * row j of `state` is what the samples so far add to the output j samples later; the last row stays zero. */
static void filter(int64_t samples, int columns, int zeros, const double *b, int poles, const double *a,
                   double *restrict state, const double *restrict balance, const double *restrict x, double *restrict y)
{
    const int taps = TAPS(zeros, poles);
    for (int64_t k = 0; k < samples; ++k, x += columns, y += columns) {
        for (int j = 0; j < taps; ++j) {
            double *const row = state + j * columns, *const next = row + columns;
            const double forth = j < zeros ? b[j] : 0, back = j > 0 && j < poles ? a[j] : 0;
            for (int i = 0; i < columns; ++i) {
                row[i] = next[i] + forth * (x[i] - balance[i]) - back * state[i];
            }
        }
        for (int i = 0; i < columns; ++i) {
            y[i] += state[i];
        }
    }
    for (int i = 0; i < taps * columns; ++i) {
        state[i] = flushed(state[i]);
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
    F(filter, "b[z], a[p], state[t,c]=, balance[c], x[n,c], y[n,c]=", "adds filtered columns; advances the state.",    \
      (NEED_SIZE(t, TAPS(SIZE(z), SIZE(p)) + 1), SAMPLES_LAST),                                                        \
      filter(LENGTH(n), SIZE(c), SIZE(z), REALS(0), SIZE(p), REALS(1), REALS(2), REALS(3), REALS(4), REALS(5)))        \
    F(model_simulate,                                                                                                  \
      "r[l], a[m], low[z], high[z], w_S[z], w_H[l], w_K[c], constant, play[l]=, creep[c]=, x[n], y[n]=",               \
      "outputs of a model for inputs; advances the states.",                                                           \
      (NEED_SIZE(l, padded(SIZE(l))), NEED_SIZE(z, padded(SIZE(z))), NEED_SIZE(c, LENGTH(m) * LENGTH(l)),              \
       SAMPLES_LAST),                                                                                                  \
      model_simulate(&MODEL, REALS(10), LENGTH(n), REALS(8), REALS(9), REALS(11)))
MAKE_BINDINGS(model)
