/* The deviation of the Duhem actuator along a path, as of duhem.py. */
#include "face_model.h"

#include <math.h>

FACE(deviation)
{
    const double *const u = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double alpha = take_number(a);
    const double b = take_number(a);
    double *const e = take_output(a, VECTOR, 1);
    double *const before = take_output(a, VECTOR, 1);
    double *const path = take_output(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            const double move = u[k] - *before, goal = -copysign(1 - b, move) / alpha;
            *e = goal + (*e - goal) * exp(-alpha * fabs(move));
            *before = u[k];
            path[k] = *e;
        }
    }
    return finish_integer(a, 0);
}
