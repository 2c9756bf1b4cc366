/* The three filters of the dynamics (prefilter.h): of the reference, of the model, and of the sensor.
 *
 * A step of each takes the same time at every sample: a few multiplications a mode, and rings for the lags, whose
 * numbers are written where they are due. All have a gain of 1, so that each is in the units of what goes in.
 */
#include "prefilter.h"

/* Excite a mode; its output, D(z) / D(1) q. */
static num excite(Mode *m, num u)
{
    m->second = minus_times(times(m->R, minus(u, m->q)), m->c_R, m->first);
    return plus_times(plus_times(m->q, m->c_D, m->first), m->second, m->inverse_D);
}

/* Go on to the next sample; q. */
static num move(Mode *m)
{
    m->first = flushed(plus(m->first, m->second));
    m->q = plus(m->q, m->first);
    return m->q;
}

/* Write the newest number of a ring to where it is due; the one that is now, `lag` samples older. */
static num delayed(num *ring, int size, num *at, num lag, num newest)
{
    const real place = *(const real *)(const void *)at;
    const int now = place > 0 && place < (real)size ? (int)place : 0;
    const num safe = within(lag, constant(0), constant((real)(size - 1)));
    for (int lane = 0; lane < WIDTH; ++lane) {
        const int due = now + (int)*entry(&safe, 0, lane);
        *entry(ring, due < size ? due : due - size, lane) = *entry(&newest, 0, lane);
    }
    *at = constant((real)(now + 1 < size ? now + 1 : 0));
    return ring[now];
}

void N(prefilter_balance)(const Prefilter *p, Shape s, num which, num level, const num *play, const num *creep)
{
    num *const levels = p->drives - s.ring - LEVELS;
    for (int i = 0; i < 3 * s.modes; ++i) { /* of all three */
        copy_where(which, &p->reference[i].q, (const num[]){level, constant(0)}, 2);
    }
    for (int i = 0; i < LEVELS + s.ring; ++i) {
        set_where(which, levels + i, level);
    }
    for (int i = 0; i <= s.ring; ++i) {
        set_where(which, p->drives + i, play[0]);
    }
    set_where(which, &p->memory->unknown, p->memory->unknown_lasts);
    copy_where(which, p->play, play, play_vectors(s) * (LANES / WIDTH));
    copy_where(which, p->creep, creep, CREEP_VECTORS * creep_vectors(s) * (LANES / WIDTH));
}

num N(reference_filter)(const Prefilter *p, Shape s, num y_ref)
{
    p->memory->output = y_ref;
    for (int i = 0; i < s.modes; ++i) {
        p->memory->output = excite(p->reference + i, p->memory->output);
    }
    return p->memory->output;
}

void N(reference_follow)(const Prefilter *p, Shape s, num v, num which)
{
    for (int i = s.modes - 1; i >= 0; --i) {
        Mode *const m = p->reference + i;
        set_where(which, &m->second, times(minus(minus(v, m->q), times(m->c_D, m->first)), m->D));
        v = plus_times(m->q, plus_times(m->second, m->c_R, m->first), m->inverse_R);
        move(m);
    }
}

num N(model_filter)(const Prefilter *p, Shape s, num y_ref)
{
    PrefilterMemory *const m = p->memory;
    const num late = delayed(m->ring, s.ring, &m->reference_at, m->reference_lag, y_ref);
    num before[LANES - 1];
    memcpy(before, m->history, sizeof before);
    memcpy(m->history + 1, before, sizeof before);
    m->behind = plus_times(late, m->decay, minus(m->behind, late));
    m->history[0] = m->behind;
    for (int i = 0; i < s.modes; ++i) {
        excite(p->model + i, m->history[0]);
        m->history[0] = move(p->model + i);
    }
    return dot(m->taps, m->history, VECTORS(LANES));
}

num N(sensor_filter)(const Prefilter *p, Shape s, num y, num *good)
{
    PrefilterMemory *const m = p->memory;
    const num before = m->filtered, left = greatest(minus(m->unknown, constant(1)), constant(0));
    set_where(*good, &m->measured, y);
    m->unknown = where(*good, left, m->unknown_lasts);
    *good = logical_and(*good, is_not(less(constant(0), m->unknown)));
    m->filtered = m->measured;
    for (int i = 0; i < s.modes; ++i) {
        m->filtered = excite(p->sensor + i, m->filtered);
        move(p->sensor + i);
    }
    return plus_times(m->filtered, m->fraction, minus(before, m->filtered));
}

num N(sensor_drive)(const Prefilter *p, Shape s, Operators operators, num x)
{
    PrefilterMemory *const m = p->memory;
    num *const amplified = p->drives + s.ring;
    *amplified = plus_times(x, m->decay, minus(*amplified, x));
    const num late = delayed(p->drives, s.ring, &m->drive_at, m->drive_lag, *amplified);
    receive(operators, s, late, p->play, p->creep);
    return late;
}
