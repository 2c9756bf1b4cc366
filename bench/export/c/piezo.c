/* The interface of piezo.h to core/compensator.h and, with learning, to the step in core/controller.h. Build with
 * -ffp-contract=off for the same numbers on every machine, and never with -ffast-math: the guards compare with NaN. */
#include "piezo.h"

#ifdef PIEZO_FLOAT
#define CORE_FLOAT
#endif
#include "core/compensator.c"
#include "core/prefilter.c"

#if PIEZO_LEARNING
#include "core/controller.c"
#include "piezo_learner.h"
#endif

static const double thresholds[] = PIEZO_R_H, zone_low[] = PIEZO_ZONE_LOW, zone_high[] = PIEZO_ZONE_HIGH;
#if PIEZO_RATES > 0
static const double creep_gains[] = PIEZO_CREEP_GAINS;
#endif
static const double exported[] = PIEZO_WEIGHTS;
#if PIEZO_RING > 0
static const double prefilter[] = PIEZO_PREFILTER;
#endif

static Compensator of(const piezo_axis *axis) { return compensator_at((void *)(uintptr_t)axis->compensator.bytes); }

/* The core declares them constant. */
static DriveSettings *settings_of(const Compensator *c) { return (DriveSettings *)(uintptr_t)c->settings; }

/* Copy constants of the export in the precision of the step. */
static void write_reals(real *to, const double *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        to[i] = (real)from[i];
    }
}

static void set_limits(const Compensator *c, double low, double high, double max_step)
{
    DriveMemory *const m = c->memory;
    m->low = (real)low;
    m->high = (real)high;
    m->unit_low = (real)((low - PIEZO_X_CENTRE) / PIEZO_X_SCALE);
    m->unit_high = (real)((high - PIEZO_X_CENTRE) / PIEZO_X_SCALE);
    settings_of(c)->max_step = (real)max_step;
}

#if PIEZO_LEARNING
static Controller controller_of(const piezo_axis *axis)
{
    char *const mailbox = (char *)(uintptr_t)axis->learner.bytes + HEAD_BYTES;
    return (Controller){of(axis), mailbox_at(mailbox, exported_shape)};
}

static void widen(const real *from, int count, double *to)
{
    for (int i = 0; i < count; ++i) {
        to[i] = (double)from[i];
    }
}

/* Restart learning from the weights in use and the states of the operators; samples and weights in transit between step
 * and learner are dropped. */
static void begin_learning(piezo_axis *axis)
{
    const Controller c = controller_of(axis);
    const Inverse *const p = &c.compensator.inverse;
    double weights[PIEZO_ALL_WEIGHTS];
    widen(p->w_H, PIEZO_THRESHOLDS, weights);
    widen(p->w_S, PIEZO_ZONES, weights + PIEZO_THRESHOLDS);
    widen(p->w_K, creep_weights(exported_shape), weights + PIEZO_THRESHOLDS + PIEZO_ZONES);
    widen(p->offset, 1, weights + PIEZO_ALL_WEIGHTS - 1);
    const Prefilter *const late = &c.compensator.prefilter;
    controller_begin(&c, PIEZO_RING > 0 ? late->play : c.compensator.play,
                     PIEZO_RING > 0 ? late->creep : c.compensator.creep);
    piezo_learner_begin(axis->learner.bytes, weights);
    axis->driven = 0;
}

piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref, piezo_real y_measured_before)
{
    const Controller c = controller_of(axis);
    if (axis->driven) {
        controller_observe(&c, c.compensator.play[0], y_measured_before);
    }
    axis->driven = 1;
    return controller_drive(&c, y_ref);
}
#else
static void begin_learning(piezo_axis *axis) { (void)axis; }

piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref)
{
    const Compensator c = of(axis);
    return compensator_step(&c, y_ref, NULL);
}
#endif

void piezo_correct(piezo_axis *axis, piezo_real y_measured)
{
    const Compensator c = of(axis);
    compensator_correct(&c, y_measured, 1);
}

void piezo_reset(piezo_axis *axis)
{
    const Compensator c = compensator_setup(axis->compensator.bytes, exported_shape);
    real weights[PIEZO_ALL_WEIGHTS];
    write_reals(c.operators.r, thresholds, PIEZO_THRESHOLDS);
#if PIEZO_RATES > 0
    write_reals(c.operators.a, creep_gains, PIEZO_RATES);
#endif
    for (int i = 0; i < zone_lanes(exported_shape); ++i) {
        c.low[i] = i < PIEZO_ZONES ? (real)zone_low[i] : -REAL_INFINITY;
        c.high[i] = i < PIEZO_ZONES ? (real)zone_high[i] : REAL_INFINITY;
    }
    *settings_of(&c) = (DriveSettings){.x_centre = (real)PIEZO_X_CENTRE,
                                       .x_scale = (real)PIEZO_X_SCALE,
                                       .y_centre = (real)PIEZO_Y_CENTRE,
                                       .y_scale = (real)PIEZO_Y_SCALE,
                                       .decay = (real)PIEZO_BLEND,
                                       .gain = (real)PIEZO_INTEGRAL_GAIN};
    *c.memory = (DriveMemory){.last_y_ref = (real)PIEZO_Y_CENTRE};
    set_limits(&c, PIEZO_LOW, PIEZO_HIGH, PIEZO_MAX_STEP);
    write_reals(weights, exported, PIEZO_ALL_WEIGHTS);
    compensator_set_weights(&c, weights);
#if PIEZO_RING > 0
    write_reals((real *)(void *)c.prefilter.reference, prefilter, sizeof prefilter / sizeof *prefilter);
#endif
#if PIEZO_LEARNING
    memset(axis->learned, 0, sizeof axis->learned);
    piezo_learner_reset(axis->learner.bytes);
#endif
    piezo_settle(axis, (piezo_real)PIEZO_X_START);
}

/* Copy the weights in the order of the core, and check that the model has an inverse: slopes are above 0, and weights
 * but the constant not below it. */
static piezo_status check(const piezo_weights *new_weights, real *weights)
{
    const int first = PIEZO_THRESHOLDS - 1, end = first + PIEZO_ZONES; /* of the slopes */
    int invertible = new_weights->w_h[0] > 0;
    real v[PIEZO_ALL_WEIGHTS];
    memcpy(weights, new_weights->w_h, sizeof new_weights->w_h);
    memcpy(weights + PIEZO_THRESHOLDS, new_weights->w_s, sizeof new_weights->w_s);
#if PIEZO_RATES > 0
    memcpy(weights + PIEZO_THRESHOLDS + PIEZO_ZONES, new_weights->w_k, sizeof new_weights->w_k);
#endif
    weights[PIEZO_ALL_WEIGHTS - 1] = new_weights->offset;
    unknowns_of(exported_shape, PIEZO_MIDDLE, weights, v);
    for (int j = 0; j < PIEZO_ALL_WEIGHTS - 2; ++j) {
        invertible = invertible && (j >= first && j < end ? v[j] > 0 : v[j] >= 0);
    }
    return !are_finite(weights, PIEZO_ALL_WEIGHTS) ? PIEZO_NOT_FINITE : invertible ? PIEZO_OK : PIEZO_NO_INVERSE;
}

piezo_status piezo_set_model(piezo_axis *axis, const piezo_weights *new_weights, piezo_real blend)
{
    const Compensator c = of(axis);
    real weights[PIEZO_ALL_WEIGHTS];
    const piezo_status status = check(new_weights, weights);
    if (!(blend >= 0 && blend < 1)) {
        return PIEZO_BAD_LIMITS;
    }
    if (status == PIEZO_OK) {
        const real before = compensator_now(&c);
        compensator_set_weights(&c, weights);
        settings_of(&c)->decay = blend;
        c.memory->bump = blend > 0 ? c.memory->bump + before - compensator_now(&c) : 0;
        begin_learning(axis);
    }
    return status;
}

piezo_status piezo_set_limits(piezo_axis *axis, piezo_real low, piezo_real high, piezo_real max_step)
{
    const Compensator c = of(axis);
    if (!(low < high && max_step > 0)) { /* NaN compares false */
        return PIEZO_BAD_LIMITS;
    }
    set_limits(&c, (double)low, (double)high, (double)max_step / PIEZO_X_SCALE);
    return PIEZO_OK;
}

piezo_status piezo_set_integral_gain(piezo_axis *axis, piezo_real per_second)
{
    if (!(per_second >= 0 && (double)per_second <= PIEZO_LARGEST_GAIN)) {
        return PIEZO_BAD_LIMITS;
    }
    const Compensator c = of(axis);
    settings_of(&c)->gain = (real)((double)per_second * PIEZO_SAMPLE_TIME_S);
    return PIEZO_OK;
}

piezo_status piezo_settle(piezo_axis *axis, piezo_real x_start)
{
    const Compensator c = of(axis);
    if (!(x_start >= c.memory->low && x_start <= c.memory->high)) {
        return PIEZO_BAD_LIMITS;
    }
    const real x = ((real)x_start - (real)PIEZO_X_CENTRE) / (real)PIEZO_X_SCALE, branch = within(-x, -1, 1);
    for (int i = 0; i < lanes(c.shape); ++i) { /* after swings through the range that died away */
        c.play[i] = x + branch * c.operators.r[i];
    }
    for (int i = 0; i < creep_lanes(c.shape); ++i) {
        c.creep[i] = c.play[i % lanes(c.shape)];
    }
    compensator_balance(&c, 1);
    begin_learning(axis);
    return PIEZO_OK;
}

void piezo_get_state(const piezo_axis *axis, piezo_state *state)
{
    const Compensator c = of(axis);
    memcpy(state->play, c.play, sizeof state->play);
#if PIEZO_RATES > 0
    memcpy(state->creep, c.creep, sizeof state->creep);
#endif
    state->bump = c.memory->bump;
    state->blend = c.settings->decay;
    state->last_y_ref = c.memory->last_y_ref;
    state->correction = c.memory->correction;
#if PIEZO_MODES > 0
    memcpy(state->modes, c.prefilter.reference, sizeof state->modes);
#endif
}

piezo_status piezo_set_state(piezo_axis *axis, const piezo_state *state)
{
    const Compensator c = of(axis);
    if (!are_finite((const real *)(const void *)state, (int64_t)(sizeof *state / sizeof(real)))) {
        return PIEZO_NOT_FINITE;
    }
    if (!(state->blend >= 0 && state->blend < 1)) {
        return PIEZO_BAD_LIMITS;
    }
    memcpy(c.play, state->play, sizeof state->play);
#if PIEZO_RATES > 0
    memcpy(c.creep, state->creep, sizeof state->creep);
#endif
    settings_of(&c)->decay = state->blend;
    c.memory->bump = state->bump;
    c.memory->last_y_ref = state->last_y_ref;
    c.memory->correction = state->correction;
    compensator_balance(&c, 1);
#if PIEZO_MODES > 0
    memcpy(c.prefilter.reference, state->modes, sizeof state->modes);
#endif
    begin_learning(axis);
    return PIEZO_OK;
}
