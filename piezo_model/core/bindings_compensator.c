/* The compensator as Python calls it; see compensator.h. */
#include "compensator.h"
#include "bindings_model.h"

#define COMPENSATOR ((Compensator[]){compensator_at(MEMORY(0))})

static void set_up(Arguments *a, void *memory, Shape s)
{
    const Compensator c = compensator_setup(memory, s);
    const Inverse *const p = &c.inverse;
    const Field fields[] = {{"settings", c.settings, sizeof *c.settings / sizeof(real)},
                            {"r", c.operators.r, lanes(s)},
                            {"a", c.operators.a, s.rates},
                            {"low", c.low, zone_lanes(s)},
                            {"high", c.high, zone_lanes(s)},
                            {"memory", c.memory, sizeof *c.memory / sizeof(real)},
                            {"play", c.play, lanes(s)},
                            {"creep", c.creep, creep_lanes(s)},
                            {"w_H", p->w_H, lanes(s)},
                            {"w_S", p->w_S, zone_lanes(s)},
                            {"w_K", p->w_K, padded(creep_weights(s))},
                            {"offset", p->offset, 1},
                            {"W_H", p->W_H, lanes(s)},
                            {"w_H_inverse", p->w_H_inverse, lanes(s)},
                            {"r_H_inverse", p->r_H_inverse, lanes(s)},
                            {"prefilter", c.prefilter.reference, prefilter_nums(s)}};
    RETURN_FIELDS(memory, fields);
}

static void run(const Compensator *c, int64_t samples, const double *y_ref, double *x)
{
    for (int64_t k = 0; k < samples; ++k) {
        x[k] = compensator_step(c, y_ref[k], NULL);
    }
}

#define BINDINGS(F)                                                                                                    \
    F(compensator_bytes, FILTERED, "size of a compensator.", 0, WHOLE_RESULT = compensator_bytes(FILTERED_AT(0)))      \
    F(compensator_setup, "state@, " FILTERED, "make a block a compensator; where its vectors stand.",                  \
      NEED_BYTES(0, compensator_bytes(FILTERED_AT(1))), set_up(&a, MEMORY(0), FILTERED_AT(1)))                         \
    F(compensator_set_weights, "state@COM2, weights[k]", "invert the model of these weights.",                         \
      NEED_SIZE(k, weight_count(COMPENSATOR->shape)), compensator_set_weights(COMPENSATOR, REALS(1)))                  \
    F(compensator_balance, "state@COM2", "begin with dynamics in balance.", 0, compensator_balance(COMPENSATOR, 1))    \
    F(compensator_now, "state@COM2", "the unit drive for the last reference at this moment.", 0,                       \
      NUMBER_RESULT = compensator_now(COMPENSATOR))                                                                    \
    F(compensator_correct, "state@COM2, y_measured", "integral action on the output that the last drive produced.", 0, \
      compensator_correct(COMPENSATOR, NUMBER(1), 1))                                                                  \
    F(compensator_step, "state@COM2, y_ref", "the drive for one reference.", 0,                                        \
      NUMBER_RESULT = compensator_step(COMPENSATOR, NUMBER(1), NULL))                                                  \
    F(compensator_run, "state@COM2, y_ref[n], x[n]=", "drives for references.", SAMPLES_LAST,                          \
      run(COMPENSATOR, LENGTH(n), REALS(1), REALS(2)))
MAKE_BINDINGS(compensator)
