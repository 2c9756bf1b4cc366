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
 * <= 0 (and >= -width) at F and >= 0 at A. The user's variables are v = origin + sign z: z is measured from a bound,
 * where there is one.
 *
 * recursive_gram.c sweeps, recursive_exchange.c sweeps until z is optimal, recursive_refresh.c makes M anew,
 * recursive_renewal.c does so a little at each row, and recursive_rows.c takes the rows.
 *
 * Sources: A. P. Dempster, Elements of Continuous Multivariate Analysis, 1969 (the sweep operator); R. W. Cottle,
 * "Principal pivoting method of quadratic programming", 1968.
 */
#ifndef CORE_RECURSIVE_H
#define CORE_RECURSIVE_H

#include "box.h"

enum { RECURSIVE_KIND = 0x53575031 };
/* Beside the statuses of status.h: a pivot is no good; the exchanges do not end. Both end inside recursive_rows.c or in
 * recursive_recover. */
enum { SINGULAR = 101, CYCLING = 102 };
enum { RECURSIVE_REFRESH = 256 }; /* rows after which M is made anew */
#define FLOOR ((real)1e-11)       /* of rho_j/G_jj where G_FF is singular */
#define SPENT 1e5                 /* what `growth` begins with there: the inverse has few digits to lose */

#ifdef CORE_FLOAT
/* Bounds from here on are none. */
#define NO_BOUND 1e15F
/* Size from which a number of a row is refused, since sums of squares have to be finite. */
#define LARGEST_ENTRY 1e15F
#else
#define NO_BOUND 1e100
#define LARGEST_ENTRY 1e100
#endif

typedef struct {
    int32_t kind, d;
    int64_t bytes;
    int32_t free_count, since_refresh;
    int32_t cap;                                /* exchanges of one row after which it ends with CAPPED; 0 for none */
    uint32_t exchanges, refreshes, cold_starts; /* so far; after years they begin again at 0 */
    double forgetting, root_growth;             /* lambda, and lambda^(-1/2) */
    double row_weight, root_weight;             /* of a new row, and the root of what the coming row enters with */
    double proximal;                            /* share of the diagonal that the proximal term has */
    double growth;                              /* the product of sigma since M was made anew */
    double next_growth;                         /* the same of the matrix being made */
    int32_t renewing, next_count;               /* whether one is being made, and on how many variables it is swept */
} RecursiveHead;

/* Vectors have ld numbers, d + 1 rounded up to whole blocks of eight. */
typedef struct {
    RecursiveHead *head;
    int d, ld;
    real *answer, *origin, *sign, *width, *lb, *ub; /* v and what takes z to it; NO_BOUND for no other bound */
    real *side; /* the sign with which the last row of M must not be negative: -1 free, +1 at the bound, 0 unbounded or
                   fixed */
    real *free; /* 1 at F and 0 at A */
    real *row;  /* the weighted row */
    real *centre, *rho; /* of the proximal term */
    real *g, *root, *u; /* the gradient; pivots and 4 rows of sweeps */
    int32_t *list;      /* of free variables */
    real *M, *G;        /* ld rows each; a row adds to G from the diagonal blocks on only */
    real *next_M, *next_free, *next_rho, *next_centre; /* of the matrix being made */
    int32_t *next_list;
    real *P, *q; /* room for the data of a cold start */
    Box cold;
} Recursive;

CORE_API int64_t recursive_bytes(int d);
CORE_API Recursive recursive_at(void *memory);
/* Make a block of recursive_bytes(d) bytes a state with the bounds lb, ub (d); recursive_begin comes next. */
CORE_API int recursive_setup(void *memory, int d, const real *lb, const real *ub, double forgetting, double row_weight,
                             double proximal);
/* Start from P (d, d), q (d) and twice the constant of the cost, at the optimum that the cold solver finds, from the
 * present answer where `warm`. OK or a status of box_take and box_solve, and then nothing has changed. */
CORE_API int recursive_begin(Recursive *s, const real *P, const real *q, real constant, int warm);
/* Take one row (xi, x) of d + 1 numbers and restore optimality; OK or CAPPED, or SINGULAR or CYCLING where only
 * recursive_recover helps; the row is in G then. NOT_FINITE, and nothing changed, for a row that cannot be taken. */
CORE_API int recursive_take(Recursive *s, const real *row);
/* Begin anew from the data that G holds. */
CORE_API int recursive_recover(Recursive *s);
/* v (d) for z, inside its box to the last bit. */
CORE_API void recursive_answer(Recursive *s);
/* The largest violation of the optimality conditions at the answer, relative to max(|q|, |G z|) by rows. */
CORE_API real recursive_error(Recursive *s);

/* What the files of this solver ask of each other. */
CORE_API void recursive_list_free(Recursive *s);
/* out -= sum over F of share[j] (row j of the matrix). */
CORE_API void recursive_subtract_free(const Recursive *s, const real *matrix, const real *share, real *out);
CORE_API void recursive_complete(const Recursive *s, real *matrix);
CORE_API int recursive_definite(const Recursive *s, int j);
CORE_API void recursive_sweep(Recursive *s, int j);
CORE_API int recursive_sweep_free(Recursive *s);
CORE_API int recursive_exchange(Recursive *s);
CORE_API int recursive_violated(const Recursive *s);
/* M <- G + diag(rho), not swept on any variable, with rho_j at least `floor` G_jj and the gradient about `centre`. */
CORE_API void recursive_unswept(Recursive *s, real floor);
/* One step of iterative refinement of the last row of M by the residual from G; twice what it lowers the cost by. */
CORE_API real recursive_refine(Recursive *s);
CORE_API int recursive_tolerable(const Recursive *s, real gain);
CORE_API int recursive_refresh(Recursive *s);
/* u = xi_A - M[:, F] xi_F and M <- M + u u'/sigma for the weighted row xi; 0 where M is left as it was for its sigma.
 */
CORE_API int recursive_move(Recursive *s);
/* The parts that one row has in making the matrix anew: before it, 0 where only recursive_refresh helps; and once M and
 * G have it, `exchanged` where the free variables have changed. */
CORE_API int recursive_use_renewed(Recursive *s);
CORE_API void recursive_renew(Recursive *s, int exchanged);

CORE_INLINE real *row_of(const Recursive *s, real *matrix, int i) { return matrix + (size_t)i * (size_t)s->ld; }
/* z with its sign turned at F, and the gradient at A. */
CORE_INLINE real *last_row(const Recursive *s) { return row_of(s, s->M, s->d); }

#endif
