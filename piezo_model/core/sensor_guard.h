/* Which samples of a sensor can be learned from; all amplitudes are unit amplitudes.
 *
 * A sample is missing when it is not a finite number; nothing else follows from that. It is refused when it lies far outside the
 * range, or when the sensor is frozen: the output is to the last bit what it was while the drive went through a noticeable share of
 * its range. A jump is a change of the output that the drive since the last good sample does not explain (a plug pulled and put
 * back, a re-zeroed sensor): what was gathered before it need not fit what comes after. Refused samples and jumps are faults, and
 * whoever learns waits until samples have been good for a while.
 */
#ifndef CORE_SENSOR_GUARD_H
#define CORE_SENSOR_GUARD_H

#include "operators.h"

enum { GOOD, MISSING, REFUSED, JUMPED };

#define PLAUSIBLE ((real)4)       /* largest output: a range given half as wide as it is must not be for ever */
/* Part of the drive in which the output must change at all, 1 % of its range: an actuator has about half its mean slope after a
 * turning point, so the converter may be as coarse as 0.5 % of the range. */
#define FROZEN_DRIVE ((real)0.02)
#define JUMP ((real)0.25)         /* change of the output since the last good sample, beyond FOLLOWING times the way of the drive */
#define FOLLOWING ((real)4)

/* The last drive; the last good output; the way of the drive since; its lowest and highest since the output changed. */
typedef struct {
    real last_x, last_y, way, x_low, x_high;
} SensorGuard;

CORE_INLINE void guard_forget(SensorGuard *g)
{
    g->last_x = g->last_y = g->x_low = g->x_high = (real)NAN;
    g->way = 0;
}

/* Verdict on one sample. */
CORE_INLINE int guard_judge(SensorGuard *g, real x, real y)
{
    if (isfinite(g->last_x)) {
        g->way += MAGNITUDE(x - g->last_x);
        g->x_low = least(g->x_low, x);
        g->x_high = most(g->x_high, x);
    } else {
        g->x_low = g->x_high = x;
    }
    g->last_x = x;
    if (!isfinite(y)) {
        return MISSING;
    }
    if (MAGNITUDE(y) > PLAUSIBLE) {
        return REFUSED;
    }
    if (y >= g->last_y && y <= g->last_y) {
        return g->x_high - g->x_low > FROZEN_DRIVE ? REFUSED : GOOD;
    }
    const int jumped = MAGNITUDE(y - g->last_y) > JUMP + FOLLOWING * g->way; /* at the first sample this compares with NaN */
    g->last_y = y;
    g->way = 0;
    g->x_low = g->x_high = x;
    return jumped ? JUMPED : GOOD;
}

#endif
