/* Creep that grows like log t, as of actuator.py. */
#include "face_model.h"
#include "operators.h"

FACE(log_creep)
{
    const double *const u = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const gain = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t states = taken_length(a);
    double *const z = take_output(a, VECTOR, states);
    double *const before = take_output(a, VECTOR, 1);
    double *const K = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
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
    return finish_integer(a, 0);
}
