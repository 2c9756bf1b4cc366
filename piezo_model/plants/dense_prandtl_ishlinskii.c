/* The sum of many plays and creep operators, as of dense_prandtl_ishlinskii.py. */
#include "face_model.h"
#include "operators.h"

FACE(face_plays_and_creep)
{
    Arguments a;
    const double *u, *r, *w_H, *w_K, *gain;
    double *z_play, *z_creep, *before, *total;
    Py_ssize_t samples, n, rates;
    (void)module;
    take_arguments(&a, "plays_and_creep(u, r, w_H, w_K, a, z_play, z_creep, u_previous, total)", given, count, 9);
    u = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    r = take_array(&a, VECTOR, ANY_LENGTH);
    n = taken_length(&a);
    w_H = take_array(&a, VECTOR, (int)n);
    w_K = take_array(&a, VECTOR, (int)n);
    gain = take_array(&a, VECTOR, ANY_LENGTH);
    rates = taken_length(&a);
    z_play = take_output(&a, VECTOR, (int)n);
    z_creep = take_output(&a, (int)n, (int)rates);
    before = take_output(&a, VECTOR, 1);
    total = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
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
    return finish_integer(&a, 0);
}
