/* The compensator as Python calls it; see compensator.h. */
#include "compensator.h"
#include "face_model.h"

TAKE_STATE(compensator, Compensator, COMPENSATOR_KIND)

FACE(compensator_bytes) { return size_for(compensator_bytes, a); }

FACE(compensator_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    need_bytes(a, 0, compensator_bytes(s));
    if (!good(a)) {
        return finish(a, NULL);
    }
    const Compensator c = compensator_setup(memory, s);
    const Inverse *const p = &c.inverse;
    const Part parts[] = {{"settings", c.settings, sizeof *c.settings / sizeof(real)},
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
                          {"r_H_inverse", p->r_H_inverse, lanes(s)}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

FACE(compensator_take)
{
    Compensator c = take_compensator(a);
    const double *const weights = take_array(a, VECTOR, weight_count(c.shape));
    if (good(a)) {
        compensator_take(&c, weights);
    }
    return finish_integer(a, 0);
}

FACE(compensator_now)
{
    Compensator c = take_compensator(a);
    return finish_number(a, good(a) ? compensator_now(&c) : 0);
}

FACE(compensator_correct)
{
    Compensator c = take_compensator(a);
    const double y = take_number(a);
    if (good(a)) {
        compensator_correct(&c, y, 1);
    }
    return finish_integer(a, 0);
}

FACE(compensator_step)
{
    Compensator c = take_compensator(a);
    const double y_ref = take_number(a);
    return finish_number(a, good(a) ? compensator_step(&c, y_ref, NULL) : 0);
}

FACE(compensator_run)
{
    Compensator c = take_compensator(a);
    const double *const y_ref = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    double *const x = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            x[k] = compensator_step(&c, y_ref[k], NULL);
        }
    }
    return finish_integer(a, 0);
}
