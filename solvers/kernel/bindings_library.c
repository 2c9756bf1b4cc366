/* Other authors' libraries in the timed loop, see library.h; and the check of data before a library sees them. */
#include "bindings_timed.h"
#include "library.h"
#include "vec8.h"

/* From the addresses of its state, which begins with Data, and of its two functions. */
#define LIBRARY_SOLVER                                                                                                 \
    (&(TimedSolver){(void *)(intptr_t)WHOLES(0)[0], SIZE(d),                                                           \
                    (int (*)(void *, const double *, const double *))(intptr_t)WHOLES(0)[1],                           \
                    (int (*)(void *, const double *, double *))(intptr_t)WHOLES(0)[2]})
#define NEED_D NEED_SIZE(d, ((const Data *)(intptr_t)WHOLES(0)[0])->d) + 1

#define SYMMETRY 1e-9 /* of the largest entry, so that what BLAS rounds is symmetric */

/* OK if count of P (d, d) and q (d) are data, NULL for none; NOT_FINITE for q, ASYMMETRIC for a P that is not finite or
 * not symmetric. The largest entry of a positive semidefinite P is on the diagonal. */
static int check(int64_t count, int64_t d, const double *P, const double *q)
{
    int refused = 0;
    if (q != NULL && !are_finite(q, count * d)) {
        return NOT_FINITE;
    }
    for (const double *M = P; M != NULL && !refused && M < P + count * d * d; M += d * d) {
        double most = 0;
        for (int64_t i = 0; i < d; ++i) {
            most = MAGNITUDE(M[i * d + i]) > most ? MAGNITUDE(M[i * d + i]) : most;
        }
        for (int64_t i = 0; i < d; ++i) {
            for (int64_t j = 0; j <= i; ++j) { /* infinity minus itself is NaN, on the diagonal too */
                refused |= !(MAGNITUDE(M[i * d + j] - M[j * d + i]) <= SYMMETRY * most);
            }
        }
    }
    return refused ? ASYMMETRIC : OK;
}

/* Copy `from`, or keep `to` for NULL. */
static void copy(double *to, const double *from, int64_t size)
{
    if (from != NULL) {
        memcpy(to, from, (size_t)size * sizeof(double));
    }
}

#define BINDINGS(F)                                                                                                    \
    F(time_library, "addresses[3]q, " TIMED, "as time_box.", NEED_D, WHOLE_RESULT = TIMED_BY(1, LIBRARY_SOLVER))       \
    F(check_all, "P[n,d,d]?, q[n,d]", "whether each P and q is good; a status.", 0,                                    \
      WHOLE_RESULT = check(LENGTH(n), LENGTH(d), REALS(0), REALS(1)))                                                  \
    F(copy_data, "to_P[d,d]=, to_q[d]=, P[d,d]?, q[d]?", "copy P and q if they are good; a status.", 0,                \
      (WHOLE_RESULT = check(1, LENGTH(d), REALS(2), REALS(3))) == OK                                                   \
          ? (copy(REALS(0), REALS(2), LENGTH(d) * LENGTH(d)), copy(REALS(1), REALS(3), LENGTH(d)))                     \
          : (void)0)
MAKE_BINDINGS(library)
