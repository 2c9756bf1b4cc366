/* Decides which samples of a sensor can be learned from; all amplitudes are in normalised units.
 *
 * A sample that is not a finite number is missing, which has no other consequence. A sample is refused if it lies far
 * outside the range, or if the sensor is frozen: the output is unchanged to the last bit while the drive covered a
 * noticeable share of its range. A jump is a change of the output that neither the drive since the last good sample nor
 * the noise explains (an interrupted connection, a re-zeroed sensor): earlier data may not fit later ones. Refused
 * samples and jumps are faults, after which a learner waits until samples have been good for a while.
 */
#ifndef CORE_SENSOR_GUARD_H
#define CORE_SENSOR_GUARD_H

#include "operators.h"

enum { GOOD, MISSING, REFUSED, JUMPED };

#define PLAUSIBLE ((real)4) /* largest output; leaves room for a range that was given too small */
/* Range of the drive over which the output must change, 1 % of the whole: after a turning point an actuator has about
 * half its mean slope, so the converter's step may be up to 0.5 % of the range. */
#define FROZEN_DRIVE ((real)0.02)
/* Largest change of the output since the last good sample, besides FOLLOWING times the path of the drive: JUMP, or
 * NOISY standard deviations of the noise, which are 6 of a change. */
#define JUMP ((real)0.25)
#define FOLLOWING ((real)4)
#define NOISY ((real)8.5)

/* The last drive; the last changed output; path, minimum and maximum of the drive since then; the largest change, which
 * follows the noise that the learner finds; counts of verdicts. */
typedef struct {
    num last_x, last_y, path_length, x_low, x_high, jump, verdicts[4];
} SensorGuard;

/* Forget the last samples and the noise where `which` is 1. */
CORE_INLINE void guard_forget(SensorGuard *g, num which)
{
    const num unknown = constant((real)NAN);
    copy_where(which, &g->last_x, (const num[]){unknown, unknown, constant(0), unknown, unknown, constant(JUMP)}, 6);
}

/* 1 where the sample is good; `fault` is 1 where it is refused or a jump. */
CORE_INLINE num guard_judge(SensorGuard *g, num x, num y, num *fault)
{
    const num begun = is_finite(g->last_x), there = is_finite(y), known = is_finite(g->last_y);
    const num path_length = where(begun, plus(g->path_length, absolute(minus(x, g->last_x))), g->path_length);
    const num low = where(begun, lowest(x, g->x_low), x), high = where(begun, greatest(x, g->x_high), x);
    const num plausible = logical_and(there, is_not(less(constant(PLAUSIBLE), absolute(y))));
    const num moved = logical_or(less(y, g->last_y), less(g->last_y, y));
    const num same = logical_and(plausible, logical_and(known, is_not(moved))),
              changed = logical_and(plausible, is_not(same));
    const num frozen = logical_and(same, less(constant(FROZEN_DRIVE), minus(high, low)));
    const num explained = plus_times(g->jump, constant(FOLLOWING), path_length);
    const num jumped = logical_and(changed, less(explained, absolute(minus(y, g->last_y))));
    const num refused = logical_or(logical_and(there, is_not(plausible)), frozen),
              good = logical_and(plausible, is_not(logical_or(frozen, jumped)));
    g->last_x = x;
    g->last_y = where(changed, y, g->last_y);
    g->path_length = where(changed, constant(0), path_length);
    g->x_low = where(changed, x, low);
    g->x_high = where(changed, x, high);
    *fault = logical_or(refused, jumped);
    if (any(is_not(good))) {
        g->verdicts[MISSING] = plus(g->verdicts[MISSING], is_not(there));
        g->verdicts[REFUSED] = plus(g->verdicts[REFUSED], refused);
        g->verdicts[JUMPED] = plus(g->verdicts[JUMPED], jumped);
    }
    g->verdicts[GOOD] = plus(g->verdicts[GOOD], good);
    return good;
}

#endif
