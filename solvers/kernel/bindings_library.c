/* Other authors' libraries in the timed loop; see library.h. */
#include "bindings_timed.h"
#include "library.h"

/* From the addresses of its state, which begins with Data, and of its two functions. */
#define LIBRARY_SOLVER                                                                                                 \
    (&(TimedSolver){(void *)(intptr_t)WHOLES(0)[0], SIZE(d),                                                           \
                    (int (*)(void *, const double *, const double *))(intptr_t)WHOLES(0)[1],                           \
                    (int (*)(void *, const double *, double *))(intptr_t)WHOLES(0)[2]})
#define NEED_D NEED_SIZE(d, ((const Data *)(intptr_t)WHOLES(0)[0])->d) + 1

/* Copy `from`, or keep `to` for NULL. */
static void copy(double *to, const double *from, int64_t size)
{
    if (from != NULL) {
        memcpy(to, from, (size_t)size * sizeof(double));
    }
}

#define BINDINGS(F)                                                                                                    \
    F(time_library, "addresses[3]q, " TIMED, "as time_box.", NEED_D, WHOLE_RESULT = TIMED_BY(1, LIBRARY_SOLVER))       \
    F(check_data, "like[d], P[d,d]?, q[d]?", "whether P and q are of d variables; an exception if not.", 0,            \
      WHOLE_RESULT = SIZE(d))                                                                                          \
    F(copy_data, "to_P[d,d]=, to_q[d]=, P[d,d]?, q[d]?", "copy P and q, None for data that stay.", 0,                  \
      (copy(REALS(0), REALS(2), LENGTH(d) * LENGTH(d)), copy(REALS(1), REALS(3), LENGTH(d))))
MAKE_BINDINGS(library)
