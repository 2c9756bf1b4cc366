/* The sum of many plays and creep operators, as of dense_prandtl_ishlinskii.py. */
#include "face_model.h"
#include "operators.h"

FACE(plays_and_creep)
{
    const double *const u = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const r = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t n = taken_length(a);
    const double *const w_H = take_array(a, VECTOR, n);
    const double *const w_K = take_array(a, VECTOR, n);
    const double *const gain = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t rates = taken_length(a);
    double *const z_play = take_output(a, VECTOR, n);
    double *const z_creep = take_output(a, n, rates);
    double *const before = take_output(a, VECTOR, 1);
    double *const total = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            total[k] = 0;
            for (Py_ssize_t i = 0; i < n; ++i) {
                double creep = 0;
                z_play[i] = play_step(u[k], r[i], z_play[i]);
                for (Py_ssize_t j = 0; j < rates; ++j) {
                    double *const z = z_creep + i * rates + j;
                    *z = creep_step(*before, r[i], gain[j], *z);
                    creep += *z;
                }
                total[k] += w_H[i] * z_play[i] + w_K[i] * creep / (double)rates;
            }
            *before = u[k];
        }
    }
    return finish_integer(a, 0);
}
