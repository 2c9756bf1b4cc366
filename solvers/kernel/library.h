/* Somebody's library in the timed loop.
 *
 * A C file of this folder has the two functions of the loop, `update` and `solve`, and exports them under its name; its
 * Python does the rest through ctypes: it finds the functions of the installed library, sets the problem up, fills in
 * the state and reads the results. Structures of a library are declared as far as they are used, and are facts of the
 * version that the Python file names.
 */
#ifndef KERNEL_LIBRARY_H
#define KERNEL_LIBRARY_H

#include "python_abi.h"
#include "status.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

/* What every state begins with: P (d, d) and q (d) of the last update, which stay where they are, and d. Its other
 * fields have eight bytes each, too: numbers, arrays and functions of the library. */
typedef struct {
    const double *P, *q;
    int64_t d;
} Data;

typedef struct {
    /* As of TimedSolver. The status is OK, or below 0 where the library refuses the data: what it calls that. */
    int (*update)(void *state, const double *P, const double *q);
    int (*solve)(void *state, const double *start, double *x);
} Library;

#define LIBRARY(name) PY_EXPORT const Library library_##name = {update, solve};

/* Remember where the data are, for a library that reads them there or needs them again. */
static inline void take_data(Data *data, const double *P, const double *q)
{
    data->P = P;
    data->q = q;
}

/* The upper triangle of a symmetric P column by column; row by row it is the lower one. */
static inline void upper_triangle(const Data *data, double *values)
{
    for (int64_t j = 0; j < data->d; ++j) {
        memcpy(values + j * (j + 1) / 2, data->P + j * data->d, (size_t)(j + 1) * sizeof(double));
    }
}

#endif
