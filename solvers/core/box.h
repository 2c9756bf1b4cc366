/* The exact minimiser of   f(x) = 1/2 x'Px + q'x   over   lb <= x <= ub.
 *
 * Units. box_data.c scales the data: x = r S z and the cost by c/r^2, all powers of two. S_jj brings c (S P S)_jj into
 * [1/2, 2), where c is 1 or 1/2, so that a power of two times P, q or the bounds changes no bit of the scaled solve,
 * and r keeps squares within the range of the numbers. That is exact, so lb, ub and the answer are the caller's to the
 * last bit. Diagonal scaling within a factor of two of unit diagonal is within a factor of two (and d) of the best
 * condition number a diagonal can give (van der Sluis, Numer. Math. 14 (1969) 14). In the scaled problem are z, its
 * gradient grad_z = q + P z, the bounds z_lb and z_ub, q, P and all that is derived from them; gains are of its cost.
 * Only `answer`, raw_q, lb and ub are in the caller's units.
 *
 * box_solve promises, with eps the rounding unit, F the free variables and s = max(|q_F|, |z|):
 *
 *  1. With OK or CAPPED, the answer is inside lb and ub to the last bit. For 2 to 5, OK.
 *  2. No free variable has a gradient: |grad_z_F| <= (d + 4) eps s/2.
 *  3. No multiplier, grad_z of a variable at a bound, is on its wrong side by so much more than 4 d eps max(|q_j|, |z|)
 *     that an exchange would gain more than gain_tolerance = (eps s)^2.
 *  4. No bound was violated, before 1, so far that an exchange would gain more than that.
 *  5. The cost before the last refinement was above its least by no more than BOX_RELATIVE_GAP |f|, or that share of
 *     the rounding of f. A small gradient does not promise this, since the curvature may be as small as d eps.
 *  6. If P is singular, 2 and 3 hold with the proximal term, 3 beyond 4 d eps s more, no bound is violated at all, and
 *     5 holds for the remaining decrease along the term's own gradient, at most 64 d eps s (box_proximal.c).
 *  7. A variable whose row of P is zero is apart: it goes to the bound that q points to.
 *  8. A cold answer depends on the data alone, and only the data decide whether there is one: a warm solve that ends
 *     without one is followed by a cold one.
 *  9. It refuses data that are not finite (NOT_FINITE), bounds that leave no x (CROSSED), a P that is not symmetric to
 *     1e-9 sqrt(P_ii P_jj) (ASYMMETRIC) or has a pivot <= 0 even with the proximal term (INDEFINITE), and a cost
 *     without a least (UNBOUNDED). Where rounding keeps it from 2 to 6, it ends with MAX_EXCHANGES or BREAKDOWN; at the
 *     limit `cap`, with CAPPED.
 *
 * box_inverse.c inverts the scaled P, box_dual.c is the dual active set method on the inverse, and box_proximal.c
 * treats singular P.
 */
#ifndef CORE_BOX_H
#define CORE_BOX_H

#include "arena.h"
#include "status.h"

enum { BOX_KIND = 0x424f5831 };
enum { LOWER = -1, FREE = 0, UPPER = 1 }; /* sides of a variable */

/* Head of the state. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
    int32_t singular;                               /* whether the last solve had the proximal term */
    int32_t cap;                                    /* exchanges after which a solve ends with CAPPED; 0 for none */
    int32_t exchanges, refinements, proximal_steps; /* of the last solve */
    int32_t definite, inverted;                     /* whether P needs no proximal term; whether M is -P^-1 */
    int32_t of_bounds, of_P, of_q;                  /* statuses of the data */
    int32_t apart;                                  /* whether a row of P is zero */
    real cost, root;                                /* c, and 1/sqrt(r) */
} BoxHead;

/* The fields of the state; vectors have ld entries, zero from d on. */
typedef struct {
    BoxHead *head;
    int d, ld;
    real *answer, *raw_q, *lb, *ub; /* the caller's */
    real *scale;                    /* S, 0 for a variable apart */
    real *q, *z_lb, *z_ub, *z, *grad_z;
    /* Of box_dual.c: the basic quantity of each variable and its feasible interval; the bound of a fixed variable, else
     * 0; 1 for a free variable, else 0; the unit of a multiplier, else 1; W_jj, 1/|W_jj| and the gain of an exchange.
     */
    real *basic, *low, *high, *fixed_at, *is_free, *unit, *diagonal, *weight, *gain;
    real *multiplier;                  /* on the way to the next dual feasible set */
    real *inverse_pivot, *coefficient; /* 2 ld numbers, one per exchange: 1/p, and the part of a column in a product */
    real *residual, *step;             /* grad_z_F and P_FF^-1 grad_z_F of a refinement */
    real *inverse_diagonal;            /* of M */
    real *linear, *centre;             /* q - delta c and c of box_proximal.c */
    real *zero;                        /* zeros */
    real *sweep_scratch;               /* 5 rows of scratch memory for a sweep on two variables */
    int32_t *side;
    real *P, *M, *U; /* S P S by rows; -P^-1, or P swept on some; 2 ld columns of exchanged variables */
} Box;

CORE_API int64_t box_bytes(int d);
CORE_API Box box_at(void *memory);

/* Initialise a block of box_bytes(d) bytes for d variables with the bounds lb, ub (d); OK, NOT_FINITE or CROSSED. */
CORE_API int box_setup(void *memory, int d, const real *lb, const real *ub);
/* Set P (d, d) and q (d), NULL to keep one; OK, NOT_FINITE, ASYMMETRIC or INDEFINITE. */
CORE_API int box_set_data(Box *s, const real *P, const real *q);
/* Begin a warm solve at x (d): variables that touch a bound are fixed there; OK or NOT_FINITE. */
CORE_API int box_start(Box *s, const real *x);
/* Solve into s->answer: cold from "all free", warm from the last sides or those of box_start, and then cold if that
 * ends without an answer, so that only the data decide whether there is one; without good data, their status. */
CORE_API int box_solve(Box *s, int warm);
/* Initialise a block and solve one program, warm from x (d). */
CORE_API int box_solve_from(void *memory, int d, const real *P, const real *q, const real *lb, const real *ub,
                            const real *x);

/* Entry j of the gradient q + P x at the answer, in the caller's units. */
CORE_API real box_gradient(const Box *s, int j);
/* Entry j of the diagonal of P^-1 in the caller's units; infinite unless P is safely positive definite. */
CORE_API real box_inverse_diagonal(const Box *s, int j);

/* Functions that the files of this solver share. */

/* c for P_00: 1/2 if its exponent is odd, else 1. */
CORE_INLINE real box_cost(real diagonal)
{
    whole bits;
    memcpy(&bits, &diagonal, sizeof bits);
    return (bits >> MANTISSA_BITS & 1) != 0 ? (real)0.5 : 1;
}

/* Coefficient of the proximal term if P is singular, relative to a diagonal of P of about one. */
#define BOX_PROXIMAL ((real)1e-11)
/* Share of the cost within which an answer is the least. */
#define BOX_RELATIVE_GAP ((real)1e-10)
/* Scale and copy P (NULL: the copy is there already) and compute M = -P^-1; 0 if P is not symmetric to the last bit
 * or not safely positive definite. */
CORE_API int box_invert(Box *s, const real *P);
/* M = P with the proximal term, swept on the free variables, and U empty; 0 if a pivot is not positive. */
CORE_API int box_sweep_free(Box *s);
/* Switch to box_proximal.c; OK, or INDEFINITE if P has a pivot <= 0 with the proximal term. */
CORE_API int box_regularise(Box *s);

/* The state of a solve. */
typedef struct {
    const real *linear;  /* q, or q - delta c */
    int count;           /* columns of U */
    int exchanges;       /* since the start */
    int precise, strict; /* whether grad_z needs twice the precision; whether multipliers have no tolerance */
    real slack;          /* tolerance on the sign of a multiplier, if W may be large */
    real largest_gain;
    real primal_gain, dual_gain; /* that of holding a free variable, and of freeing one whose multiplier is wrong */
    real rounding;               /* eps s */
    real gain_tolerance, violation_tolerance; /* of a multiplier, (eps s)^2; of a bound, or 0 if W may be large */
} Search;

/* Begin on -P^-1 at "all free" or, warm, at the present sides. */
CORE_API void box_begin(Box *s, Search *search, int warm);
/* Continue to the optimum for search->linear; OK, CAPPED, BREAKDOWN or MAX_EXCHANGES, with z and grad_z. */
CORE_API int box_dual_active_set(Box *s, Search *search);
/* The same for a singular P, from the start. */
CORE_API int box_proximal_point(Box *s, Search *search, int warm);

#endif
