/* The exact minimiser of   1/2 x'Px + q'x   over   lb <= x <= ub.
 *
 * New data are inverted (box_inverse.c) and solved by exchanges (box_exchange.c). What is not safely positive definite,
 * finite and symmetric, and what the exchanges do not bring to an end, goes to the factorisation with its stricter
 * rules (box_fallback.h, box_pivoting.c, box_dual.c), which decides. Which path a cold problem takes follows from its
 * data alone, so the answer does too.
 *
 * The variables are scaled, x = S z with S_jj a power of two that brings (S P S)_jj into [1/2, 2): that is exact, so
 * lb, ub and the answer are the caller's to the last bit, and tolerances may be absolute. Diagonal scaling within a
 * factor of two of unit diagonal is within a factor of two (and d) of the best condition number a diagonal can give
 * (van der Sluis, Numer. Math. 14 (1969) 14).
 */
#ifndef CORE_BOX_H
#define CORE_BOX_H

#include "arena.h"
#include "status.h"

enum { BOX_KIND = 0x424f5831 };
enum { LOWER = -1, FREE = 0, UPPER = 1 }; /* where a variable is; one whose bounds are equal is never free at the end */

/* What stands at the head of the state. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
    int32_t inverted, factorised,
        singular; /* which of M and the program of the fallback are there; whether that has the proximal term */
    int32_t cap;  /* exchanges after which a solve ends with CAPPED; 0 for none */
    int32_t exchanges, systems, dual_steps, proximal_steps; /* what the last solve took */
    int32_t fallbacks;                                      /* solves left to the factorisation */
} BoxHead;

/* Names for the parts of the state; vectors have ld numbers, zero from d on. First what a solve by exchanges touches.
 */
typedef struct {
    BoxHead *head;
    int d, ld;
    real *answer, *scale, *q, *lo, *hi; /* answer in x, the rest in z */
    real *raw_q, *lb, *ub;              /* as the caller gave them */
    real *x, *g;                        /* z and its gradient q + P z */
    /* Of the exchanges (box_exchange.c): the basic variables, their intervals, x at the bounds and zero elsewhere; 1
     * where free and 0 elsewhere, and 1 or the unit at a bound; W_jj, 1/|W_jj| and what exchanging j gains. */
    real *basic, *low, *high, *held, *is_free, *unit, *diagonal, *weight, *gain;
    real *factor, *share;   /* 2 ld numbers, one an exchange: 1/p, and what a column takes part with */
    real *residual, *step;  /* g_F and P_FF^-1 g_F of a refinement */
    real *inverse_diagonal; /* of M */
    real *zero, *v, *w;     /* zeros; two irregular vectors, by which symmetry is seen */
    real *pair;             /* 4 rows of a pass of sweeps */
    int32_t *side;
    real *P, *M, *U; /* S P S by rows; -P^-1; 2 ld columns of exchanged variables */
    void *fallback;  /* see box_fallback.h; it takes the place of U */
} Box;

CORE_API int64_t box_bytes(int d);
CORE_API Box box_at(void *memory);

/* Make a block of box_bytes(d) bytes a state of d variables with the bounds lb, ub (d); OK, NOT_FINITE or CROSSED. */
CORE_API int box_setup(void *memory, int d, const real *lb, const real *ub);
/* Take other bounds, before other data; OK, NOT_FINITE or CROSSED. */
CORE_API int box_take_bounds(Box *s, const real *lb, const real *ub);
/* Take P (d, d) or q (d); OK, NOT_FINITE, ASYMMETRIC or INDEFINITE. */
CORE_API int box_take_hessian(Box *s, const real *P);
CORE_API int box_take_linear(Box *s, const real *q);
/* Begin a warm solve at x (d): at a bound what touches it, else free; OK or NOT_FINITE. */
CORE_API int box_start(Box *s, const real *x);
/* Solve, cold from "all free", warm from the last sides or those of box_start; the answer stands in s->answer. */
CORE_API int box_solve(Box *s, int warm);
/* Solve another program cold, with nothing in its answer of the one before. */
CORE_API int box_solve_anew(Box *s, const real *P, const real *q, const real *lb, const real *ub);
/* As box_solve, by the factorisation alone. */
CORE_API int box_solve_factorised(Box *s, int warm);

/* What the files of this solver ask of each other. */
#define BOX_LARGE                                                                                                      \
    ((real)1e7) /* |x|/|q| from which a residual needs twice the precision: a plain one leaves d eps^2 (|x|/|q|)^2 */
CORE_API int box_invert(Box *s, const real *P);
CORE_API int box_exchange_all(Box *s, int warm);
CORE_API int box_factorise_copy(Box *s);
CORE_API void box_rescale(Box *s);

#endif
