/* Updates and solves, each timed from inside: no call from Python is in a figure, and one reading of the clock is. */
#define _POSIX_C_SOURCE 200809L
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include "embedded.h"

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* What the last solve returned. */
int embedded_time(int count, const double *P, const double *q, const double *start, int64_t *updates, int64_t *solves)
{
    int ended = -1;
    for (int k = 0; k < count; ++k) {
        const int64_t first = now();
        embedded_update(P, q);
        const int64_t second = now();
        ended = embedded_solve(start);
        solves[k] = now() - second;
        updates[k] = second - first;
    }
    return ended;
}
