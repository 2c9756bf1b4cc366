/* The deviation of the Duhem actuator along a path, as of duhem.py. */
#include "face_model.h"

#include <math.h>

FACE(face_deviation)
{
    Arguments a;
    const double *u;
    double alpha, b, *e, *before, *path;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "deviation(u, alpha, b, e, u_before, path)", given, count, 6);
    u = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    alpha = take_number(&a);
    b = take_number(&a);
    e = take_output(&a, VECTOR, 1);
    before = take_output(&a, VECTOR, 1);
    path = take_output(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            const double move = u[k] - *before, goal = -copysign(1 - b, move) / alpha;
            *e = goal + (*e - goal) * exp(-alpha * fabs(move));
            *before = u[k];
            path[k] = *e;
        }
    }
    return finish_integer(&a, 0);
}
