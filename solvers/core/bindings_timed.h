/* The timed loop and its arguments, which are the last ones of every function that times a solver. */
#ifndef CORE_BINDINGS_TIMED_H
#define CORE_BINDINGS_TIMED_H

#include "bindings.h"
#include "timed_calls.h"

/* time_calls on a solver of d variables with these arguments, numbered from i; returns the last status. */
#define TIMED "q[n,d], P[n,dd]?, start[d]?, most_ns#0:, updates[n]q=, solves[n]q=, answers[n,d]=, made[1]q="
#define TIMED_BY(i, solver)                                                                                            \
    time_calls(solver, LENGTH(n), REALS(i + 1), REALS(i), REALS(i + 2), WHOLE(i + 3), WHOLES(i + 4), WHOLES(i + 5),    \
               REALS(i + 6), WHOLES(i + 7))

#endif
