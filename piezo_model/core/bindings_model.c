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

static void set_up(Arguments *a, void *memory, Shape s, double offset)
{
    const Model m = model_setup(memory, s, offset);
    const Part parts[] = {{"r", m.operators.r, lanes(s)},  {"a", m.operators.a, s.rates},
                          {"low", m.S.low, zone_lanes(s)}, {"high", m.S.high, zone_lanes(s)},
                          {"w_S", m.S.w, zone_lanes(s)},   {"w_H", m.w_H, lanes(s)},
                          {"w_K", m.w_K, creep_lanes(s)}};
    RETURN_PARTS(memory, parts);
}

#define BINDINGS(F)                                                                                                    \
    F(play, "x[n], r[i], z[i]=, out[n,i]=", "play operators over samples; z moves on.", SAMPLES_LAST,                  \
      plays(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3)))                                               \
    F(creep, "x[n], r[i], a[i], z[i]=, out[n,i]=", "creep operators over samples; z moves on.", SAMPLES_LAST,          \
      creeps(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3), REALS(4)))                                    \
    F(dead_zone, "u[n], low[i], high[i], out[n,i]=", "dead zones over samples.", SAMPLES_LAST,                         \
      dead_zones(LENGTH(n), SIZE(i), REALS(0), REALS(1), REALS(2), REALS(3)))                                          \
    F(model_bytes, SHAPED, "size of a model.", 0, WHOLE_RESULT = model_bytes(SHAPE_AT(0)))                             \
    F(model_setup, "state@, " SHAPED ", constant", "make a block a model; where its vectors stand.",                   \
      NEED_BYTES(0, model_bytes(SHAPE_AT(1))), set_up(&a, MEMORY(0), SHAPE_AT(1), NUMBER(5)))                          \
    F(model_simulate, "state@MOD1, play[l]=, creep[c]=, x[n], y[n]=", "outputs for inputs; the states move on.",       \
      SAMPLES_LAST, model_simulate((Model[]){model_at(MEMORY(0))}, REALS(3), LENGTH(n), REALS(1), REALS(2), REALS(4)))
MAKE_BINDINGS(model)
