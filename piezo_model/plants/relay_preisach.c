/* The sum over lines of relays, as of relay_preisach.py: each is a play and the distribution function of its line. */
#include "face_model.h"
#include "operators.h"

FACE(relay_lines)
{
    const double *const u = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const r = take_array(a, VECTOR, ANY_LENGTH);
    const int n = (int)taken_length(a);
    const double *const c = take_array(a, VECTOR, n);
    const double *const sigma = take_array(a, VECTOR, n);
    const double *const gain = take_array(a, VECTOR, n);
    const double shift = take_number(a);
    double *const z = take_output(a, VECTOR, n);
    double *const total = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
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
    return finish_integer(a, 0);
}
