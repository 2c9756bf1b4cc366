/* How a solver of the core ends. Python has the sentence of each (solvers/core/__init__.py). */
#ifndef CORE_STATUS_H
#define CORE_STATUS_H

enum {
    OK,
    UNBOUNDED,  /* q points down a direction that P does not see and no bound stops */
    INDEFINITE, /* beyond rounding */
    ENDLESS,    /* no active set met the optimality conditions within the limit of exchanges */
    NOT_FINITE,
    CROSSED, /* a lower bound above its upper bound or at +inf, or an upper bound at -inf */
    ASYMMETRIC,
    BREAKDOWN, /* P is too close to indefinite even with the proximal term */
    CAPPED     /* the limit of exchanges was met; the answer is feasible, and the next solve may go on from it */
};

/* A problem of d variables; an exported folder compiles with its d as a constant, -DCORE_VARIABLES=18. */
#ifdef CORE_VARIABLES
#define VARIABLES(problem) CORE_VARIABLES
#else
#define VARIABLES(problem) ((problem)->d)
#endif

#endif
