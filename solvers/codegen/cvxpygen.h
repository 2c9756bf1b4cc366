/* What differs between the solvers behind CVXPYgen, beside embedded_status. */
#ifndef CVXPYGEN_H
#define CVXPYGEN_H

#include "cpg_solve.h"
#include "embedded.h"

/* Ask for a tolerance, absolute and relative alike. */
void choose_tolerance(double tolerance);
/* Let the next solve be a cold one. */
void forget(void);
/* Whether the solver itself says solved. */
int found(void);

#endif
