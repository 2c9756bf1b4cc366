/* Whether the output rises with the input, as the model does, or falls (a reversed connection), by the correlation r of
 * drive and output:
 *
 *     stretch   samples over which the drive covers at least PART of its range so far, and SHORTEST
 *     r         over deviations from the mean of each stretch, in sums that are multiplied by FADE at each stretch
 *
 * With k samples, r is sure if r^2 k >= SIGNIFICANT. The output rises if r > 0 is sure after FEW stretches, or if r > 0
 * after MANY. It falls if r < 0 and r^2 > FALLS after SOME stretches in a range of WIDE. In between, the last verdict
 * holds. Noise, hysteresis, drift and a lag below a quarter of the period make |r| smaller but do not change its sign
 * for long. Weights are handed over only while the output rises: the inverse of a model of the wrong direction would
 * drive the actuator to a limit and keep it there.
 */
#ifndef CORE_DIRECTION_H
#define CORE_DIRECTION_H

#include "learner.h"

#define PART ((real)0.4)
#define SHORTEST ((real)0.03)
#define FADE ((real)0.96875)
#define SIGNIFICANT ((real)9)
#define FALLS ((real)0.4)
#define FEW ((real)2.5)
#define SOME ((real)12)
#define MANY ((real)20)
#define WIDE ((real)0.06)

/* Forget the direction of the output. */
CORE_INLINE void forget_direction(LearnerMemory *m, num which)
{
    copy_where(which, m->evidence, (const num[EVIDENCE]){0}, EVIDENCE);
    span_clear(m->stretch, 2 * SPAN, which);
}

/* The sum of products of deviations from the means. */
CORE_INLINE num deviations(const num *e, int a, int b, int ab)
{
    return minus(e[ab], divided(times(e[a], e[b]), greatest(e[ONE], constant(1))));
}

/* Judge the direction of the output by a block of this span: REVERSED if it falls from now on. */
CORE_INLINE int judge_direction(const Learner *l, const Block *block, const num *span)
{
    LearnerMemory *const m = l->memory;
    num *const e = m->evidence, *const driven = m->stretch + SPAN;
    for (int k = 0; k < block->head->count; ++k) {
        const num measured = from_shared(block->y, k), good = logical_and(m->learning, is_finite(measured));
        const num x = logical_and(good, from_shared(block->x, k)), y = where(good, measured, constant(0));
        const num terms[] = {good, x, y, times(x, x), times(x, y), times(y, y)};
        for (int i = 0; i < MOMENTS; ++i) {
            e[i] = plus(e[i], terms[i]);
        }
    }
    span_widen(m->stretch, span, m->learning);
    span_widen(driven, m->stretch, constant(1));
    const num range = minus(driven[X_HIGH], driven[X_LOW]);
    const num covered = minus(m->stretch[X_HIGH], m->stretch[X_LOW]);
    const num ends = is_not(less(covered, greatest(constant(SHORTEST), times(constant(PART), range))));
    const num stretch[] = {e[ONE], constant(1), deviations(e, X, X, X_X), deviations(e, X, Y, X_Y),
                           deviations(e, Y, Y, Y_Y)};
    for (int i = COUNT; i < DIRECTION; ++i) {
        set_where(ends, e + i, plus_times(stretch[i - COUNT], constant(FADE), e[i]));
    }
    copy_where(ends, e, (const num[MOMENTS]){0}, MOMENTS);
    span_clear(m->stretch, SPAN, ends);
    const num known = times(e[XX], e[YY]), explained = times(e[XY], e[XY]);
    const num sure = logical_and(less(constant(FEW), e[STRETCHES]),
                                 less(times(constant(SIGNIFICANT), known), times(explained, e[COUNT])));
    const num rises = logical_and(less(constant(0), e[XY]), logical_or(sure, less(constant(MANY), e[STRETCHES])));
    const num falls = logical_and(logical_and(less(e[XY], constant(0)), less(times(constant(FALLS), known), explained)),
                                  logical_and(less(constant(SOME), e[STRETCHES]), less(constant(WIDE), range)));
    const num turns = logical_and(falls, is_not(less(e[DIRECTION], constant(0))));
    e[DIRECTION] = where(rises, constant(1), where(falls, constant(-1), e[DIRECTION]));
    return any(turns) ? REVERSED : 0;
}

#endif
