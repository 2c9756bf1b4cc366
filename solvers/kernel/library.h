/* Other authors' libraries in the timed loop.
 *
 * A C file of this folder has the two functions of the loop, `update` and `solve`, and exports them under its name. Its
 * Python file does the rest through ctypes: it finds the functions of the installed library, sets the problem up, fills
 * in the state and reads the results. Structures of a library are declared as far as they are used, for the version
 * that the Python file names.
 */
#ifndef KERNEL_LIBRARY_H
#define KERNEL_LIBRARY_H

#include "python_abi.h"
#include "status.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

/* The beginning of every state: P (d, d) and q (d) of the last update, which remain in memory, and d. The other fields
 * have eight bytes each, too: numbers, arrays and functions of the library. */
typedef struct {
    const double *P, *q;
    int64_t d;
} Data;

typedef struct {
    /* As in TimedSolver. The status is OK, or the library's own negative flag if it refuses the data. */
    int (*update)(void *state, const double *P, const double *q);
    int (*solve)(void *state, const double *start, double *x);
} Library;

#define LIBRARY(name) PY_EXPORT const Library library_##name = {update, solve};

/* Keep pointers to the data, NULL for those that stay, for a library that does not copy them. */
static inline void set_data(Data *data, const double *P, const double *q)
{
    data->P = P != NULL ? P : data->P;
    data->q = q != NULL ? q : data->q;
}

#endif
