/* The functions of embedded.h as the timed loop calls them. The solver keeps its problem itself, so they need no state.
 */
#include "library.h"

#include "embedded.h"

static int update(void *state, const double *P, const double *q)
{
    (void)state;
    embedded_update(P, q);
    return OK;
}

static int solve(void *state, const double *start, double *x)
{
    (void)state;
    if (embedded_solve(start) == 0) {
        embedded_answer(x);
    }
    return OK;
}

LIBRARY(embedded)
