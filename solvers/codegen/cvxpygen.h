/* The functions that differ between the solvers behind CVXPYgen, besides embedded_status. */
#ifndef CVXPYGEN_H
#define CVXPYGEN_H

#include "cpg_solve.h"
#include "embedded.h"

/* Set the absolute and the relative tolerance. */
void choose_tolerance(double tolerance);
/* Make the next solve a cold one. */
void forget(void);
/* Whether the solver reports success. */
int found(void);

#endif
