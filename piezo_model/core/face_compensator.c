/* The compensator as Python calls it; see compensator.h. */
#include "compensator.h"
#include "face_model.h"

static Shape take_compensator(Arguments *a, Compensator *c)
{
    void *const memory = take_state(a, COMPENSATOR_KIND);
    if (memory != NULL) {
        *c = compensator_at(memory);
    } else {
        memset(c, 0, sizeof *c);
    }
    return c->shape;
}

FACE(face_compensator_bytes)
{
    (void)module;
    return size_for(compensator_bytes, "compensator_bytes(n, zones, rates, offset)", given, count);
}

FACE(face_compensator_setup)
{
    Arguments a;
    Compensator c;
    Shape s;
    void *memory;
    (void)module;
    take_arguments(&a, "compensator_setup(state, n, zones, rates, offset)", given, count, 5);
    memory = take_state(&a, 0);
    s = take_shape(&a);
    need_bytes(&a, 0, compensator_bytes(s));
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    compensator_setup(memory, s);
    c = compensator_at(memory);
    const Part parts[] = {
        {"r", c.operators.r, lanes(s)}, {"a", c.operators.a, creep_lanes(s)}, {"low", c.S_inverse.low, zone_lanes(s)},
        {"high", c.S_inverse.high, zone_lanes(s)}, {"w_S", c.S_inverse.w, zone_lanes(s)}, {"w_H", c.w_H, lanes(s)},
        {"W_H", c.W_H, lanes(s)}, {"w_H_inverse", c.w_H_inverse, lanes(s)}, {"r_H_inverse", c.r_H_inverse, lanes(s)},
        {"w_K", c.w_K, creep_lanes(s)}, {"weights", c.weights, weight_count(s)},
        {"limits", c.limits, sizeof *c.limits / sizeof(real)}, {"fade", c.fade, sizeof *c.fade / sizeof(real)},
        {"feedback", c.feedback, sizeof *c.feedback / sizeof(real)},
        {"play", c.play, lanes(s)}, {"creep", c.creep, creep_lanes(s)}};
    return finish_parts(&a, memory, parts, (int)(sizeof parts / sizeof *parts));
}

/* Both ways to take weights. */
static PyObject *weights_for(void (*take)(Compensator *, const real *), const char *signature, PyObject *const *given,
                             Py_ssize_t count)
{
    Arguments a;
    Compensator c;
    Shape s;
    const double *weights;
    take_arguments(&a, signature, given, count, 2);
    s = take_compensator(&a, &c);
    weights = take_array(&a, VECTOR, weight_count(s));
    if (good(&a)) {
        take(&c, weights);
    }
    return finish_integer(&a, 0);
}

FACE(face_compensator_take)
{
    (void)module;
    return weights_for(compensator_take, "compensator_take(state, weights)", given, count);
}

FACE(face_compensator_hand_over)
{
    (void)module;
    return weights_for(compensator_hand_over, "compensator_hand_over(state, weights)", given, count);
}

FACE(face_compensator_now)
{
    Arguments a;
    Compensator c;
    (void)module;
    take_arguments(&a, "compensator_now(state)", given, count, 1);
    take_compensator(&a, &c);
    return finish_number(&a, good(&a) ? compensator_now(&c) : 0);
}

FACE(face_compensator_correct)
{
    Arguments a;
    Compensator c;
    double y;
    (void)module;
    take_arguments(&a, "compensator_correct(state, y)", given, count, 2);
    take_compensator(&a, &c);
    y = take_number(&a);
    if (good(&a)) {
        compensator_correct(&c, y);
    }
    return finish_integer(&a, 0);
}

FACE(face_compensator_step)
{
    Arguments a;
    Compensator c;
    double y_ref;
    (void)module;
    take_arguments(&a, "compensator_step(state, y_ref)", given, count, 2);
    take_compensator(&a, &c);
    y_ref = take_number(&a);
    return finish_number(&a, good(&a) ? compensator_step(&c, y_ref) : 0);
}

FACE(face_compensator_run)
{
    Arguments a;
    Compensator c;
    const double *y_ref;
    double *x;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "compensator_run(state, y_ref, x)", given, count, 3);
    take_compensator(&a, &c);
    y_ref = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    x = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            x[k] = compensator_step(&c, y_ref[k]);
        }
    }
    return finish_integer(&a, 0);
}
