/* The optimum of a box problem whose data grow by one row at a time.
 *
 *     minimise 1/2 sum_k w_k (z'xi_k + x_k)^2  subject to  0 <= z <= width,
 *     Gram matrix G = sum_k w_k (xi_k, x_k) (xi_k, x_k)'
 *
 * With F the free and A the other variables (x among them, it is never freed), the matrix swept on F is
 *
 *     M_FF = -G_FF^-1,    M_FA = G_FF^-1 G_FA,    M_AA = G_AA - G_AF G_FF^-1 G_FA,
 *
 * symmetric, and its last row is the answer: M_xF = -z_F and M_xA is the gradient at A. So z is optimal iff that row is
 * <= 0 (and >= -width) at F and >= 0 at A. The user's variables are v = origin + sign z: z is measured from a bound
 * if there is one.
 *
 * recursive_start.c begins from a cold solve, recursive_rows.c appends rows, recursive_exchange.c sweeps until z is
 * optimal, and recursive_renewal.c recomputes M from time to time.
 *
 * Sources: A. P. Dempster, Elements of Continuous Multivariate Analysis, 1969 (the sweep operator); R. W. Cottle,
 * "Principal pivoting method of quadratic programming", 1968.
 */
#ifndef CORE_RECURSIVE_H
#define CORE_RECURSIVE_H

#include "box.h"

enum { RECURSIVE_KIND = 0x53575031 };
/* Further statuses: a pivot is too small; the exchanges do not end. recursive_refresh or recursive_recover handles
 * both.
 */
enum { SINGULAR = 101, CYCLING = 102 };
enum { RECURSIVE_REFRESH = 256 }; /* rows after which M is recomputed */

#ifdef CORE_FLOAT
/* Magnitude from which a bound counts as infinite. */
#define NO_BOUND 1e15F
/* Magnitude from which an entry of a row is refused, since sums of squares must be finite. */
#define LARGEST_ENTRY 1e15F
#else
#define NO_BOUND 1e100
#define LARGEST_ENTRY 1e100
#endif

typedef struct {
    int32_t kind, d;
    int64_t bytes;
    int32_t since_refresh;
    int32_t cap;                                /* exchanges of one row after which it ends with CAPPED; 0 for none */
    uint32_t exchanges, refreshes, cold_starts; /* totals, which wrap around */
    double forgetting, root_growth;             /* lambda, and lambda^(-1/2) */
    double row_weight, root_weight;             /* weight of a new row; root of the weight of the next row in G */
    double proximal;                            /* coefficient of the proximal term relative to the diagonal */
    double growth;                              /* product of sigma since the last refresh */
} RecursiveHead;

/* Vectors have ld numbers, d + 1 rounded up to whole blocks of eight. */
typedef struct {
    RecursiveHead *head;
    int d, ld;
    real *answer, *origin, *sign, *width, *lb, *ub; /* v, and the map from z to it; NO_BOUND without another bound */
    real *side; /* the sign with which the last row of M must not be negative: -1 free, +1 at the bound, 0 unbounded or
                   fixed */
    real *row;  /* the weighted row */
    real *g, *u, *share; /* the gradient; a row of M, or z; the coefficients of the rows of M in a sum */
    real *is_free;       /* 1 at F and 0 at A */
    real *rho, *centre;  /* of the proximal term */
    real *M, *G;         /* ld rows; a row of data is added to G from the diagonal blocks on only */
    real *P, *q;         /* the data of a cold start */
    Box cold;
} Recursive;

CORE_API int64_t recursive_bytes(int d);
CORE_API Recursive recursive_at(void *memory);
/* Initialise a block of recursive_bytes(d) bytes with the bounds lb, ub (d); call recursive_begin next. */
CORE_API int recursive_setup(void *memory, int d, const real *lb, const real *ub, double forgetting, double row_weight,
                             double proximal);
/* Start from P (d, d), q (d) and twice the constant of the cost, at the optimum by box_solve, which starts from the
 * present answer if `warm`. OK, or a status of box_set_data or box_solve; then nothing has changed. */
CORE_API int recursive_begin(Recursive *s, const real *P, const real *q, real constant, int warm);
/* Append one row (xi, x) of d + 1 numbers and restore optimality; OK, CAPPED, or SINGULAR or CYCLING if only
 * recursive_recover helps, with the row in G. NOT_FINITE if the row is refused; then nothing has changed. */
CORE_API int recursive_append(Recursive *s, const real *row);
/* Recompute M with the proximal term about the present z, refine z and exchange; OK, CAPPED, SINGULAR or CYCLING. */
CORE_API int recursive_refresh(Recursive *s);
/* Start again from the data in G. */
CORE_API int recursive_recover(Recursive *s);
/* Write v (d) for z, exactly inside its box. */
CORE_API void recursive_answer(Recursive *s);
/* The largest violation of the optimality conditions at the answer, relative to max(|q|, |G z|) by rows. */
CORE_API real recursive_error(Recursive *s);

/* Functions that the files of this solver share. */
CORE_API int recursive_violated(const Recursive *s);
CORE_API int recursive_exchange(Recursive *s);
/* Free variable j or move it to its bound; 0 and nothing changed if its pivot is not above its rounding error. */
CORE_API int recursive_sweep(const Recursive *s, int j);
/* Copy the upper part of G below its diagonal blocks. */
CORE_API void recursive_complete(const Recursive *s);
/* g <- q + (G + diag rho) z - diag(rho) c. */
CORE_API void recursive_residual(const Recursive *s);

CORE_INLINE real *row_of(const Recursive *s, real *matrix, int i) { return matrix + (size_t)i * (size_t)s->ld; }
/* -z at F, and the gradient at A. */
CORE_INLINE real *last_row(const Recursive *s) { return row_of(s, s->M, s->d); }

#endif
