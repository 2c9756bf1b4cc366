/* The exact minimiser of   1/2 x'Px + q'x   over   lb <= x <= ub.
 *
 * box_data.c scales the data: x = r S z and the cost by c/r^2, all powers of two. S_jj brings c (S P S)_jj into
 * [1/2, 2), where c is 1 or 1/2, so that a power of two times P, q or the bounds changes no bit of the scaled solve,
 * and r keeps squares within the range of the numbers. That is exact, so lb, ub and the answer are the caller's to the
 * last bit. Diagonal scaling within a factor of two of unit diagonal is within a factor of two (and d) of the best
 * condition number a diagonal can give (van der Sluis, Numer. Math. 14 (1969) 14). A variable whose row of P is zero is
 * apart: it goes to the bound that q points to. box_inverse.c inverts the scaled P, box_dual.c is the dual active set
 * method on the inverse and states what OK promises, and box_proximal.c treats singular P. A cold answer depends on the
 * data alone.
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

/* The parts of the state; vectors have ld entries, zero from d on. */
typedef struct {
    BoxHead *head;
    int d, ld;
    real *answer, *scale, *q, *lo, *hi; /* answer in x; S, 0 for a variable apart; in z */
    real *raw_q, *lb, *ub;              /* unscaled */
    real *x, *g;                        /* z and its gradient q + P z */
    /* Of box_dual.c: the basic quantity of each variable and its feasible interval; the bound of a held variable, else
     * 0; 1 for a free variable, else 0; the unit of a multiplier, else 1; W_jj, 1/|W_jj| and the gain of an exchange.
     */
    real *basic, *low, *high, *held, *is_free, *unit, *diagonal, *weight, *gain;
    real *multiplier;                  /* on the way to the next dual feasible set */
    real *inverse_pivot, *coefficient; /* 2 ld numbers, one per exchange: 1/p, and the part of a column in a product */
    real *residual, *step;             /* g_F and P_FF^-1 g_F of a refinement */
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
/* Begin a warm solve at x (d): variables that touch a bound are held there; OK or NOT_FINITE. */
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
/* Share of the cost within which an answer is the least; with the rounding of float, what that allows. */
#define BOX_RELATIVE_GAP ((real)(REAL_EPSILON < 1e-10 ? 1e-10 : 1e-5))
/* Scale and copy P (NULL: the copy is there already) and compute M = -P^-1; 0 if P is not symmetric to the last bit
 * or not safely positive definite. */
CORE_API int box_invert(Box *s, const real *P);
/* M = P with the proximal term, swept on the free variables, and U empty; 0 if a pivot is not positive. */
CORE_API int box_sweep_free(Box *s);
/* Switch to box_proximal.c; OK, or INDEFINITE if P has a pivot <= 0 with the proximal term. */
CORE_API int box_regularise(Box *s);

/* The state of a solve. */
typedef struct {
    const real *linear;          /* q, or q - delta c */
    int count;                   /* columns of U */
    int exchanges;               /* since the start */
    int precise, strict;         /* whether g needs twice the precision; whether multipliers have no tolerance */
    real slack;                  /* tolerance on the sign of a multiplier, if W may be large */
    real most;                   /* the largest gain */
    real primal_gain, dual_gain; /* that of holding a free variable, and of freeing one whose multiplier is wrong */
    real rounding;               /* eps max(|q|, |x|) */
    real negligible, tolerated;  /* gains to ignore: the square of `rounding`; the same, or 0 if W may be large */
} Search;

/* Begin on -P^-1 at "all free" or, warm, at the present sides. */
CORE_API void box_begin(Box *s, Search *search, int warm);
/* Continue to the optimum for search->linear; OK, CAPPED, BREAKDOWN or MAX_EXCHANGES, with x and g. */
CORE_API int box_dual_active_set(Box *s, Search *search);
/* The same for a singular P, from the start. */
CORE_API int box_proximal_point(Box *s, Search *search, int warm);

#endif
