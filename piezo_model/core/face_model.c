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

PyObject *size_for(int64_t (*bytes)(Shape), const char *signature, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    Shape shape;
    take_arguments(&a, signature, given, count, 4);
    shape = take_shape(&a);
    return finish_integer(&a, good(&a) ? bytes(shape) : 0);
}

FACE(face_play)
{
    Arguments a;
    const double *x, *r;
    double *z, *out;
    Py_ssize_t samples;
    int n;
    (void)module;
    take_arguments(&a, "play(x, r, z, out)", given, count, 4);
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    r = take_array(&a, VECTOR, ANY_LENGTH);
    n = (int)taken_length(&a);
    z = take_output(&a, VECTOR, n);
    out = take_output(&a, (int)samples, n);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            for (int i = 0; i < n; ++i) {
                z[i] = out[k * n + i] = play_step(x[k], r[i], z[i]);
            }
        }
    }
    return finish_integer(&a, 0);
}

FACE(face_creep)
{
    Arguments a;
    const double *x, *r, *gain;
    double *z, *out;
    Py_ssize_t samples;
    int n;
    (void)module;
    take_arguments(&a, "creep(x, r, a, z, out)", given, count, 5);
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    r = take_array(&a, VECTOR, ANY_LENGTH);
    n = (int)taken_length(&a);
    gain = take_array(&a, VECTOR, n);
    z = take_output(&a, VECTOR, n);
    out = take_output(&a, (int)samples, n);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            for (int i = 0; i < n; ++i) {
                out[k * n + i] = z[i];
                z[i] = creep_step(x[k], r[i], gain[i], z[i]);
            }
        }
    }
    return finish_integer(&a, 0);
}

FACE(face_dead_zone)
{
    Arguments a;
    const double *u, *low, *high;
    double *out;
    Py_ssize_t samples;
    int n;
    (void)module;
    take_arguments(&a, "dead_zone(u, low, high, out)", given, count, 4);
    u = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    low = take_array(&a, VECTOR, ANY_LENGTH);
    n = (int)taken_length(&a);
    high = take_array(&a, VECTOR, n);
    out = take_output(&a, (int)samples, n);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            for (int i = 0; i < n; ++i) {
                out[k * n + i] = dead_zone_step(u[k], low[i], high[i]);
            }
        }
    }
    return finish_integer(&a, 0);
}

FACE(face_model_bytes)
{
    (void)module;
    return size_for(model_bytes, "model_bytes(n, zones, rates, offset)", given, count);
}

FACE(face_model_setup)
{
    Arguments a;
    Shape s;
    void *memory;
    double offset;
    Model m;
    (void)module;
    take_arguments(&a, "model_setup(state, n, zones, rates, offset, constant)", given, count, 6);
    memory = take_state(&a, 0);
    s = take_shape(&a);
    offset = take_number(&a);
    need_bytes(&a, 0, model_bytes(s));
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    m = model_setup(memory, s, offset);
    const Part parts[] = {
        {"r", m.operators.r, lanes(s)}, {"a", m.operators.a, creep_lanes(s)}, {"low", m.S.low, zone_lanes(s)},
        {"high", m.S.high, zone_lanes(s)}, {"w_S", m.S.w, zone_lanes(s)}, {"w_H", m.w_H, lanes(s)},
        {"w_K", m.w_K, creep_lanes(s)}};
    return finish_parts(&a, memory, parts, (int)(sizeof parts / sizeof *parts));
}

FACE(face_model_simulate)
{
    Arguments a;
    Model m;
    void *memory;
    const double *x;
    double *play, *creep, *y;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "model_simulate(state, play, creep, x, y)", given, count, 5);
    memory = take_state(&a, MODEL_KIND);
    if (memory != NULL) {
        m = model_at(memory);
    } else {
        memset(&m, 0, sizeof m);
    }
    play = take_output(&a, VECTOR, lanes(m.shape));
    creep = take_output(&a, VECTOR, creep_lanes(m.shape));
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    y = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        model_simulate(&m, x, samples, play, creep, y);
    }
    return finish_integer(&a, 0);
}
