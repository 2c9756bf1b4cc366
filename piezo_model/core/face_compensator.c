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
    compensator_setup(memory, s);
    const Compensator c = compensator_at(memory);
    const Part parts[] = {
        {"r", c.operators.r, lanes(s)}, {"a", c.operators.a, creep_lanes(s)}, {"low", c.S_inverse.low, zone_lanes(s)},
        {"high", c.S_inverse.high, zone_lanes(s)}, {"w_S", c.S_inverse.w, zone_lanes(s)}, {"w_H", c.w_H, lanes(s)},
        {"W_H", c.W_H, lanes(s)}, {"w_H_inverse", c.w_H_inverse, lanes(s)}, {"r_H_inverse", c.r_H_inverse, lanes(s)},
        {"w_K", c.w_K, creep_lanes(s)}, {"weights", c.weights, weight_count(s)},
        {"limits", c.limits, sizeof *c.limits / sizeof(real)}, {"fade", c.fade, sizeof *c.fade / sizeof(real)},
        {"feedback", c.feedback, sizeof *c.feedback / sizeof(real)},
        {"play", c.play, lanes(s)}, {"creep", c.creep, creep_lanes(s)}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

/* Both ways to take weights. */
static PyObject *weights_for(void (*take)(Compensator *, const real *), Arguments *a)
{
    Compensator c = take_compensator(a);
    const double *const weights = take_array(a, VECTOR, weight_count(c.shape));
    if (good(a)) {
        take(&c, weights);
    }
    return finish_integer(a, 0);
}

FACE(compensator_take) { return weights_for(compensator_take, a); }
FACE(compensator_hand_over) { return weights_for(compensator_hand_over, a); }

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
        compensator_correct(&c, y);
    }
    return finish_integer(a, 0);
}

FACE(compensator_step)
{
    Compensator c = take_compensator(a);
    const double y_ref = take_number(a);
    return finish_number(a, good(a) ? compensator_step(&c, y_ref) : 0);
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
            x[k] = compensator_step(&c, y_ref[k]);
        }
    }
    return finish_integer(a, 0);
}
