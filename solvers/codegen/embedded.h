/* The functions of an embedded solver, which keeps its problem in static memory:
 *
 *     minimise 1/2 x'P x + q'x   subject to   lb <= x <= ub
 *
 * problem.h is written for each shape of problem: D variables; `below` lists the BELOW variables with a finite
 * lower bound, `above` the ABOVE ones with a finite upper bound, and `bounded` the BOUNDED ones with either.
 */
#ifndef EMBEDDED_H
#define EMBEDDED_H

#include "problem.h"

/* Take the bounds lb, ub (D), none of them NaN, and the settings of the solver, in the order of its Python class; 0
 * unless they are refused, after which nothing is solved. */
int embedded_setup(const double *lb, const double *ub, const double *settings);
/* Take P (D x D, row by row, symmetric) and q (D). */
void embedded_update(const double *P, const double *q);
/* Solve, from `start` (D) or cold if that is NULL; 0 if the solver reports success. */
int embedded_solve(const double *start);
/* Copy the last answer x (D). */
void embedded_answer(double *x);
/* Copy its multipliers z (D) of the bounds, P x + q + z = 0. */
void embedded_multipliers(double *z);
/* The status of the last solve in the solver's own words. */
const char *embedded_status(void);
int embedded_iterations(void);

#endif
