/* Elementary operators and the model as Python calls them. */
#include "face_model.h"
#include "model.h"

Shape take_shape(Arguments *a)
{
    Shape s;
    s.n = (int32_t)take_integer(a, 0, MOST_OPERATORS);
    s.zones = (int32_t)take_integer(a, 1, MOST_OPERATORS);
    s.rates = (int32_t)take_integer(a, 0, MOST_OPERATORS);
    s.offset = (int32_t)take_integer(a, 0, 1);
    return s;
}

PyObject *size_for(int64_t (*bytes)(Shape), Arguments *a)
{
    const Shape shape = take_shape(a);
    return finish_integer(a, good(a) ? bytes(shape) : 0);
}

TAKE_STATE(model, Model, MODEL_KIND)

FACE(play)
{
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const r = take_array(a, VECTOR, ANY_LENGTH);
    const int n = (int)taken_length(a);
    double *const z = take_output(a, VECTOR, n);
    double *const out = take_output(a, samples, n);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            for (int i = 0; i < n; ++i) {
                z[i] = out[k * n + i] = play_step(x[k], r[i], z[i]);
            }
        }
    }
    return finish_integer(a, 0);
}

FACE(creep)
{
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const r = take_array(a, VECTOR, ANY_LENGTH);
    const int n = (int)taken_length(a);
    const double *const gain = take_array(a, VECTOR, n);
    double *const z = take_output(a, VECTOR, n);
    double *const out = take_output(a, samples, n);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            for (int i = 0; i < n; ++i) {
                out[k * n + i] = z[i];
                z[i] = creep_step(x[k], r[i], gain[i], z[i]);
            }
        }
    }
    return finish_integer(a, 0);
}

FACE(dead_zone)
{
    const double *const u = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const low = take_array(a, VECTOR, ANY_LENGTH);
    const int n = (int)taken_length(a);
    const double *const high = take_array(a, VECTOR, n);
    double *const out = take_output(a, samples, n);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            for (int i = 0; i < n; ++i) {
                out[k * n + i] = dead_zone_step(u[k], low[i], high[i]);
            }
        }
    }
    return finish_integer(a, 0);
}

FACE(model_bytes) { return size_for(model_bytes, a); }

FACE(model_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    const double offset = take_number(a);
    need_bytes(a, 0, model_bytes(s));
    if (!good(a)) {
        return finish(a, NULL);
    }
    const Model m = model_setup(memory, s, offset);
    const Part parts[] = {{"r", m.operators.r, lanes(s)},  {"a", m.operators.a, s.rates},
                          {"low", m.S.low, zone_lanes(s)}, {"high", m.S.high, zone_lanes(s)},
                          {"w_S", m.S.w, zone_lanes(s)},   {"w_H", m.w_H, lanes(s)},
                          {"w_K", m.w_K, creep_lanes(s)}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

FACE(model_simulate)
{
    Model m = take_model(a);
    double *const play = take_output(a, VECTOR, lanes(m.shape));
    double *const creep = take_output(a, VECTOR, creep_lanes(m.shape));
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    double *const y = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        model_simulate(&m, x, samples, play, creep, y);
    }
    return finish_integer(a, 0);
}
