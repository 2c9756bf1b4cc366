/* Creep that grows like log t, as of actuator.py. */
#include "face_model.h"
#include "operators.h"

FACE(face_log_creep)
{
    Arguments a;
    const double *u, *gain;
    double *z, *before, *K;
    Py_ssize_t samples, states;
    (void)module;
    take_arguments(&a, "log_creep(u, a, z, u_previous, K)", given, count, 5);
    u = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    gain = take_array(&a, VECTOR, ANY_LENGTH);
    states = taken_length(&a);
    z = take_output(&a, VECTOR, (int)states);
    before = take_output(&a, VECTOR, 1);
    K = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            double total = 0;
            for (Py_ssize_t j = 0; j < states; ++j) {
                z[j] = creep_step(*before, 0, gain[j], z[j]);
                total += z[j];
            }
            K[k] = total / (double)states;
            *before = u[k];
        }
    }
    return finish_integer(&a, 0);
}
