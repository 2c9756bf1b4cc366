/* The compensator of core/compensator.h behind the interface of piezo.h. Build with -ffp-contract=off for the same numbers on every
 * machine, and never with -ffast-math: the guards are comparisons with NaN. */
#include "piezo.h"

#ifdef PIEZO_FLOAT
#define CORE_FLOAT
#endif
#include "core/compensator.c"

#if PIEZO_LEARNING
#include "piezo_learner.h"
#endif

static const double thresholds[] = PIEZO_R_H, zone_low[] = PIEZO_ZONE_LOW, zone_high[] = PIEZO_ZONE_HIGH;
#if PIEZO_RATES > 0
static const double creep_gains[] = PIEZO_CREEP_GAINS;
#endif
static const double exported[] = PIEZO_WEIGHTS;

static Compensator of(const piezo_axis *axis) { return compensator_at((void *)(uintptr_t)axis->compensator.bytes); }

static void set_limits(Compensator *c, double low, double high, double max_step)
{
    DriveLimits *const p = c->limits;
    p->low = (real)low;
    p->high = (real)high;
    p->unit_low = (real)((low - PIEZO_X_CENTRE) / PIEZO_X_SCALE);
    p->unit_high = (real)((high - PIEZO_X_CENTRE) / PIEZO_X_SCALE);
    p->max_step = (real)max_step;
}

void piezo_correct(piezo_axis *axis, piezo_real y_measured)
{
    Compensator c = of(axis);
    compensator_correct(&c, y_measured);
}

#if PIEZO_LEARNING
static void start_learning(piezo_axis *axis)
{
    const Compensator c = of(axis);
    double weights[PIEZO_ALL_WEIGHTS], play[PIEZO_PLAY], creep[PIEZO_RATES * PIEZO_PLAY + 1];
    for (int i = 0; i < PIEZO_ALL_WEIGHTS; ++i) {
        weights[i] = (double)c.weights[i];
    }
    for (int i = 0; i < PIEZO_PLAY; ++i) {
        play[i] = (double)c.play[i];
    }
    for (int i = 0; i < PIEZO_RATES * PIEZO_PLAY; ++i) {
        creep[i] = (double)c.creep[i];
    }
    piezo_learner_reset(axis->learner.bytes, weights, play, creep);
    axis->driven = 0;
}

void piezo_observe(piezo_axis *axis, piezo_real y_measured)
{
    double found[PIEZO_ALL_WEIGHTS];
    if (axis->driven && piezo_learner_observe(axis->learner.bytes, (double)axis->last_x, (double)y_measured, found)) {
        Compensator c = of(axis);
        real weights[PIEZO_ALL_WEIGHTS];
        for (int i = 0; i < PIEZO_ALL_WEIGHTS; ++i) {
            weights[i] = (real)found[i];
        }
        compensator_hand_over(&c, weights);
    }
    if (axis->driven && piezo_learner_trusts(axis->learner.bytes)) {
        piezo_correct(axis, y_measured);
    }
}

piezo_real piezo_drive(piezo_axis *axis, piezo_real y_ref)
{
    Compensator c = of(axis);
    axis->last_x = compensator_step(&c, y_ref);
    axis->driven = 1;
    return axis->last_x;
}

piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref, piezo_real y_measured_before)
{
    piezo_observe(axis, y_measured_before);
    return piezo_drive(axis, y_ref);
}

piezo_events piezo_get_events(const piezo_axis *axis)
{
    long long counts[4];
    piezo_events events;
    piezo_learner_events((void *)(uintptr_t)axis->learner.bytes, counts);
    events.hand_overs = (uint32_t)counts[0];
    events.refusals = (uint32_t)counts[1];
    events.sensor_faults = (uint32_t)counts[2];
    events.numeric_faults = (uint32_t)counts[3];
    return events;
}
#else
piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref)
{
    Compensator c = of(axis);
    return compensator_step(&c, y_ref);
}

static void start_learning(piezo_axis *axis) { (void)axis; }
#endif

void piezo_reset(piezo_axis *axis)
{
    const Shape shape = CORE_SHAPE;
    Compensator c;
    real weights[PIEZO_ALL_WEIGHTS];
    compensator_setup(axis->compensator.bytes, shape);
    c = of(axis);
    for (int i = 0; i < PIEZO_THRESHOLDS; ++i) {
        c.operators.r[i] = (real)thresholds[i];
    }
#if PIEZO_RATES > 0
    for (int i = 0; i < PIEZO_RATES * PIEZO_PLAY; ++i) {
        c.operators.a[i] = (real)creep_gains[i / PIEZO_PLAY];
    }
#endif
    for (int i = 0; i < zone_lanes(shape); ++i) {
        c.S_inverse.low[i] = i < PIEZO_ZONES ? (real)zone_low[i] : -REAL_INFINITY;
        c.S_inverse.high[i] = i < PIEZO_ZONES ? (real)zone_high[i] : REAL_INFINITY;
    }
    c.limits->x_centre = (real)PIEZO_X_CENTRE;
    c.limits->x_scale = (real)PIEZO_X_SCALE;
    c.limits->y_centre = (real)PIEZO_Y_CENTRE;
    c.limits->y_scale = (real)PIEZO_Y_SCALE;
    set_limits(&c, PIEZO_LOW, PIEZO_HIGH, PIEZO_MAX_STEP);
    c.fade->decay = (real)PIEZO_FADE;
    c.fade->last_y_ref = (real)PIEZO_Y_CENTRE;
    c.feedback->gain = (real)PIEZO_INTEGRAL_GAIN;
    c.feedback->given = (real)NAN;
    for (int i = 0; i < PIEZO_ALL_WEIGHTS; ++i) {
        weights[i] = (real)exported[i];
    }
    compensator_take(&c, weights);
    start_learning(axis);
}

/* The weights in the order of the core, if they make a model that has an inverse. */
static piezo_status check(const piezo_weights *given, real *weights)
{
    real slope = 0;
    int finite = 1, invertible = given->w_h[0] > 0;
    memcpy(weights, given->w_h, sizeof given->w_h);
    memcpy(weights + PIEZO_THRESHOLDS, given->w_s, sizeof given->w_s);
#if PIEZO_RATES > 0
    memcpy(weights + PIEZO_THRESHOLDS + PIEZO_ZONES, given->w_k, sizeof given->w_k);
#endif
    weights[PIEZO_ALL_WEIGHTS - 1] = given->offset;
    for (int i = 0; i < PIEZO_ALL_WEIGHTS; ++i) {
        const int may_be_negative = (i >= PIEZO_THRESHOLDS && i < PIEZO_THRESHOLDS + PIEZO_ZONES) || i == PIEZO_ALL_WEIGHTS - 1;
        finite = finite && isfinite(weights[i]);
        invertible = invertible && (may_be_negative || weights[i] >= 0);
    }
    for (int i = PIEZO_MIDDLE; i < PIEZO_ZONES; ++i) {
        slope += given->w_s[i];
        invertible = invertible && slope > 0;
    }
    slope = given->w_s[PIEZO_MIDDLE];
    for (int i = PIEZO_MIDDLE - 1; i >= 0; --i) {
        slope += given->w_s[i];
        invertible = invertible && slope > 0;
    }
    return !finite ? PIEZO_NOT_FINITE : invertible ? PIEZO_OK : PIEZO_NO_INVERSE;
}

piezo_status piezo_set_model(piezo_axis *axis, const piezo_weights *given, piezo_real fade)
{
    Compensator c = of(axis);
    real weights[PIEZO_ALL_WEIGHTS];
    const piezo_status status = check(given, weights);
    if (!(fade >= 0 && fade < 1)) {
        return PIEZO_BAD_LIMITS;
    }
    if (status == PIEZO_OK) {
        compensator_hand_over(&c, weights);
        c.fade->decay = fade;
        c.fade->bump = fade > 0 ? c.fade->bump : 0;
        start_learning(axis);
    }
    return status;
}

piezo_status piezo_set_limits(piezo_axis *axis, piezo_real low, piezo_real high, piezo_real max_step)
{
    Compensator c = of(axis);
    if (!(low < high && max_step > 0)) { /* NaN compares false */
        return PIEZO_BAD_LIMITS;
    }
    set_limits(&c, (double)low, (double)high, (double)max_step / PIEZO_X_SCALE);
    return PIEZO_OK;
}

piezo_status piezo_set_integral_gain(piezo_axis *axis, piezo_real per_second)
{
    const double gain = (double)per_second * PIEZO_SAMPLE_TIME_S;
    if (!(gain >= 0 && gain <= 1)) {
        return PIEZO_BAD_LIMITS;
    }
    of(axis).feedback->gain = (real)gain;
    return PIEZO_OK;
}

void piezo_get_state(const piezo_axis *axis, piezo_state *state)
{
    const Compensator c = of(axis);
    memcpy(state->play, c.play, sizeof state->play);
#if PIEZO_RATES > 0
    memcpy(state->creep, c.creep, sizeof state->creep);
#endif
    state->bump = c.fade->bump;
    state->fade = c.fade->decay;
    state->last_y_ref = c.fade->last_y_ref;
    state->correction = c.feedback->correction;
}

piezo_status piezo_set_state(piezo_axis *axis, const piezo_state *state)
{
    const Compensator c = of(axis);
    int finite = isfinite(state->bump) && isfinite(state->fade) && isfinite(state->last_y_ref)
        && isfinite(state->correction);
    for (int i = 0; i < PIEZO_PLAY; ++i) {
        finite = finite && isfinite(state->play[i]);
    }
#if PIEZO_RATES > 0
    for (int i = 0; i < PIEZO_RATES * PIEZO_PLAY; ++i) {
        finite = finite && isfinite(state->creep[i]);
    }
#endif
    if (!finite) {
        return PIEZO_NOT_FINITE;
    }
    memcpy(c.play, state->play, sizeof state->play);
#if PIEZO_RATES > 0
    memcpy(c.creep, state->creep, sizeof state->creep);
#endif
    c.fade->bump = state->bump;
    c.fade->decay = state->fade;
    c.fade->last_y_ref = state->last_y_ref;
    c.feedback->correction = state->correction;
    c.feedback->given = (real)NAN;
    start_learning(axis);
    return PIEZO_OK;
}
