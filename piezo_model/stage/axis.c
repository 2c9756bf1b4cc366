/* Lever and structure of an axis, as of axis.py: the exact answer of a damped oscillator to forces that are held. */
#include "face_model.h"

FACE(structure_response)
{
    const double *const f = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const F = take_array(a, 2, 2);
    double *const s = take_output(a, VECTOR, 2);
    double *const z = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            const double deviation = s[0] - f[k], speed = s[1];
            s[0] = f[k] + F[0] * deviation + F[1] * speed;
            s[1] = F[2] * deviation + F[3] * speed;
            z[k] = s[0];
        }
    }
    return finish_integer(a, 0);
}
