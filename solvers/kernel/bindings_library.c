/* Other authors' libraries in the timed loop; see library.h. */
#include "bindings_timed.h"
#include "library.h"

/* From the addresses of its state, which begins with Data, and of its two functions. */
#define LIBRARY_SOLVER                                                                                                 \
    (&(TimedSolver){(void *)(intptr_t)WHOLES(0)[0], SIZE(d),                                                           \
                    (int (*)(void *, const double *, const double *))(intptr_t)WHOLES(0)[1],                           \
                    (int (*)(void *, const double *, double *))(intptr_t)WHOLES(0)[2]})
#define NEED_D NEED_SIZE(d, ((const Data *)(intptr_t)WHOLES(0)[0])->d) + 1

#define BINDINGS(F)                                                                                                    \
    F(time_library, "addresses[3]q, " TIMED, "as time_box.", NEED_D, WHOLE_RESULT = TIMED_BY(1, LIBRARY_SOLVER))       \
    F(library_follow, "addresses[3]q, last[d]=, " FOLLOWED, "as box_follow.", NEED_D,                                  \
      WHOLE_RESULT = FOLLOWED_BY(2, LIBRARY_SOLVER, REALS(1)))
MAKE_BINDINGS(library)
