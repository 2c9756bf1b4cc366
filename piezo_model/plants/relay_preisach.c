/* The sum over lines of relays, as of relay_preisach.py: each is a play and the distribution function of its line. */
#include "face_model.h"
#include "operators.h"

FACE(face_relay_lines)
{
    Arguments a;
    const double *u, *r, *c, *sigma, *gain;
    double shift, *z, *total;
    Py_ssize_t samples;
    int n;
    (void)module;
    take_arguments(&a, "relay_lines(u, r, c, sigma, gain, shift, z, total)", given, count, 8);
    u = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    r = take_array(&a, VECTOR, ANY_LENGTH);
    n = (int)taken_length(&a);
    c = take_array(&a, VECTOR, n);
    sigma = take_array(&a, VECTOR, n);
    gain = take_array(&a, VECTOR, n);
    shift = take_number(&a);
    z = take_output(&a, VECTOR, n);
    total = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            total[k] = -shift;
            for (int i = 0; i < n; ++i) {
                double t;
                z[i] = play_step(u[k], r[i], z[i]);
                t = (z[i] - c[i]) / sigma[i];
                total[k] += gain[i] * t / sqrt(1 + t * t);
            }
        }
    }
    return finish_integer(&a, 0);
}
