/* The functions of an embedded solver, which keeps its problem in static memory:
 *
 *     minimise 1/2 x'P x + q'x   subject to   lb <= x <= ub
 *
 * problem.h is written for each shape of problem: D variables; `below` lists the BELOW variables with a finite
 * lower bound, `above` the ABOVE ones with a finite upper bound, and `bounded` the BOUNDED ones with either.
 */
#ifndef EMBEDDED_H
#define EMBEDDED_H

#include "library.h"
#include "problem.h"

/* A solver exports LIBRARY(embedded), whose `update` and `solve` need no state, and: */

/* Take the bounds lb, ub (D), none of them NaN, and the settings of the solver, in the order of its Python class; 0
 * unless they are refused, after which nothing is solved. */
int embedded_setup(const double *lb, const double *ub, const double *settings);
/* The status of the last solve in the solver's own words, its multipliers z (D) of the bounds, P x + q + z = 0, and its
 * number of iterations, or -1. */
const char *embedded_report(double *z, int *iterations);

#endif
