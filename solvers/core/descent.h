/* Projected gradient steps on   minimise 1/2 x'Px + q'x   subject to   lb <= x <= ub,   plain and accelerated.
 *
 * The steps are taken in the variables w = x / D, with D_j = P_jj^(-1/2) or 1, so that a box stays a box. One rule
 * determines the step size: eta = 2 ratio / lambda_max(D P D), where `ratio` = 1 is the limit of stability
 * and lambda_max an upper bound of it, closer than a thousandth.
 */
#ifndef CORE_DESCENT_H
#define CORE_DESCENT_H

#include "arena.h"
#include "status.h"

enum { DESCENT_KIND = 0x44534331 };

/* Head of the state. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
    double eta;
    int64_t steps;          /* of the last run */
    int32_t met;            /* whether the answer met its tolerance */
    double threshold, unit; /* squared length of a step that meets it, and the unit of its square */
} ProjectedGradientHead;

typedef struct {
    ProjectedGradientHead *head;
    int d, ld;                      /* number of variables, and rounded up to a multiple of eight */
    real *w, *next;                 /* the iterate, and the point to project; both divided by D */
    real *shift, *carry;            /* -eta D q, and that plus w (or the point with momentum) */
    real *lower, *upper, *momentum; /* bounds divided by D; the point with momentum of the accelerated steps */
    real *D, *lb, *ub, *q, *answer; /* in the variables x */
    real *columns;                  /* of -eta D P D, d of ld numbers */
    real *copy;                     /* of D P D, overwritten by eliminations */
} ProjectedGradient;

CORE_API int64_t descent_bytes(int d);
CORE_API ProjectedGradient descent_at(void *memory);
/* Initialise a block of descent_bytes(d) bytes for d variables with the bounds lb, ub (d); x, P and q are zero. */
CORE_API int descent_setup(void *memory, int d, const real *lb, const real *ub);
/* Set P (d, d) and q (d), NULL to keep one; scale to unit diagonal if `scaled`. OK, NOT_FINITE, ASYMMETRIC or
 * INDEFINITE. Steps begin anew after that. */
CORE_API int descent_set_data(const ProjectedGradient *s, const real *P, const real *q, real ratio, int scaled);
/* Begin at the projection of x (d), or of 0 for NULL. */
CORE_API void descent_start(const ProjectedGradient *s, const real *x);
/* Take up to `steps` steps; returns their number. See descent.c and acceleration.c for the tests that end them early.
 */
CORE_API int64_t projected_steps(const ProjectedGradient *s, int64_t steps, real tolerance);
CORE_API int64_t accelerated_steps(const ProjectedGradient *s, int64_t steps, real tolerance);
/* Write x (d) for w to s->answer, exactly at a bound if w is, and judge it. */
CORE_API void descent_answer(const ProjectedGradient *s);

/* |v|^2 of ld entries, in units in which squares neither overflow nor vanish. */
CORE_INLINE real length_squared(const real *v, real unit, int ld)
{
    vec8 total = zeros();
    for (int j = 0; j < ld; j += LANES) {
        const vec8 entries = mul(load(v + j), splat(unit));
        total = plus_product(total, entries, entries);
    }
    return sum8(total);
}

#endif
