/* Lever and structure of an axis, as of axis.py: the exact answer of a damped oscillator to forces that are held. */
#include "face_model.h"

FACE(face_structure_response)
{
    Arguments a;
    const double *f, *F;
    double *s, *z;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "structure_response(f, F, s, z)", given, count, 4);
    f = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    F = take_array(&a, 2, 2);
    s = take_output(&a, VECTOR, 2);
    z = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            const double deviation = s[0] - f[k], speed = s[1];
            s[0] = f[k] + F[0] * deviation + F[1] * speed;
            s[1] = F[2] * deviation + F[3] * speed;
            z[k] = s[0];
        }
    }
    return finish_integer(&a, 0);
}
