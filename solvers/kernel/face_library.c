/* Somebody's library in the timed loop; see library.h. */
#include "library.h"

#include "face_solvers.h"

/* The addresses of its state, which begins with Data, and of its two functions. */
static TimedSolver take_library(Arguments *a)
{
    const int64_t *const addresses = take_integers(a, 3);
    TimedSolver solver = {NULL, 0, NULL, NULL};
    if (good(a)) {
        solver.solver = (void *)(intptr_t)addresses[0];
        solver.d = (int)((const Data *)solver.solver)->d;
        solver.update = (int (*)(void *, const double *, const double *))(intptr_t)addresses[1];
        solver.solve = (int (*)(void *, const double *, double *))(intptr_t)addresses[2];
    }
    return solver;
}

FACE(time_library)
{
    const TimedSolver solver = take_library(a);
    return finish_timed(a, &solver);
}

FACE(library_follow)
{
    const TimedSolver solver = take_library(a);
    double *const last = take_output(a, VECTOR, solver.d);
    return finish_followed(a, &solver, last);
}
