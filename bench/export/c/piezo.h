/* A compensator of hysteresis and creep for a controller, alone or with learning that identifies its model while it
 * runs.
 *
 * Everything that it knows is in a piezo_axis of the caller's; it allocates nothing, and several axes run side by side.
 *
 *     static piezo_axis axis;
 *     piezo_reset(&axis);
 *     every PIEZO_SAMPLE_TIME_S:   x = piezo_step(&axis, y_ref);                      alone
 *                                  x = piezo_step(&axis, y_ref, y_measured_before);   with learning
 *     behind it, with learning:    piezo_learn(&axis);
 *
 * where y_measured_before is the output that the last x has produced, NaN where there is none.
 *
 * With learning, the step belongs into an interrupt: it takes nearly the same time at every sample. piezo_learn is the
 * task behind it, in the main loop, a task of lower priority or another thread, or right after the step. Step and task
 * may run at the same time, on one core or on coherent ones, and neither waits for the other. An axis has one of each.
 */
#ifndef PIEZO_H
#define PIEZO_H

#include "piezo_parameters.h"

#include <math.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifdef PIEZO_FLOAT
typedef float piezo_real;
#else
typedef double piezo_real;
#endif

typedef enum {
    PIEZO_OK = 0,
    PIEZO_NOT_FINITE, /* a number is NaN or infinite */
    PIEZO_NO_INVERSE, /* the model has no inverse: a weight or a slope has the wrong sign */
    PIEZO_BAD_LIMITS
} piezo_status;

/* Weights of a model, unit amplitudes. */
typedef struct {
    piezo_real w_h[PIEZO_THRESHOLDS]; /* play; the first > 0, the others >= 0 */
    piezo_real w_s[PIEZO_ZONES];      /* inverse superposition; sums outwards from the middle > 0 */
#if PIEZO_RATES > 0
    piezo_real w_k[PIEZO_THRESHOLDS]; /* creep, >= 0 */
#endif
    piezo_real offset;
} piezo_weights;

/* What the actuator has seen, unit amplitudes, and what is left of the last change of model. */
typedef struct {
    piezo_real play[PIEZO_PLAY]; /* the first, of threshold zero, is the last input */
#if PIEZO_RATES > 0
    piezo_real creep[PIEZO_RATES * PIEZO_PLAY]; /* rate by rate */
#endif
    piezo_real bump, fade;
    piezo_real last_y_ref, correction; /* in the output unit, the second what integral action has added */
} piezo_state;

#if PIEZO_LEARNING
/* How often what has happened since the reset: hand-overs of new weights and refusals, faults of sensor and arithmetic;
 * new weights that came after their sample, and blocks of samples for which there was no room, both since piezo_learn
 * was late. */
typedef struct {
    uint32_t hand_overs, refusals, sensor_faults, numeric_faults, late_offers, dropped_blocks;
} piezo_events;

enum { PIEZO_LEARNED = 4 }; /* those that piezo_learn counts */
#endif

/* Nobody's business but that of the functions below. */
typedef struct {
    union {
        double alignment;
        unsigned char bytes[PIEZO_COMPENSATOR_BYTES];
    } compensator;
#if PIEZO_LEARNING
    union {
        double alignment;
        unsigned char bytes[PIEZO_LEARNER_BYTES];
    } learner;
    uint32_t learned[PIEZO_LEARNED];
    int driven;
#endif
} piezo_axis;

/* The exported model and limits; at rest at the centre of the range. Call it first. */
void piezo_reset(piezo_axis *axis);

#if PIEZO_LEARNING
/* The interrupt: take the output that the last drive has produced, then the drive for the reference. A reference that
 * is NaN or infinite holds the drive where it is; whatever the reference, the drive is finite and inside its limits.
 * The output moves the integral action, where PIEZO_INTEGRAL_GAIN is not 0 and the guard trusts the sensor, and it is
 * handed to the learner, PIEZO_BLOCK samples at a time. */
piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref, piezo_real y_measured_before);

/* The task: learn from one block of samples; whether there was one. New weights are taken PIEZO_DELAY samples behind
 * the samples that they come from, so the drive does not depend on when the task ran. Where it is later than that, they
 * are taken with the next block; where PIEZO_BLOCKS are full, samples are left out. Both are counted. */
int piezo_learn(piezo_axis *axis);

/* May be called from anywhere. */
piezo_events piezo_get_events(const piezo_axis *axis);
#else
/* The drive that brings the actuator to the reference. A reference that is NaN or infinite holds the drive where it is;
 * whatever the reference, the drive is finite and inside its limits. */
piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref);
#endif

/* Integral action, where PIEZO_INTEGRAL_GAIN is not 0: take the output that the last drive has produced. With learning,
 * piezo_step does it; alone, call it before each step where there is a sensor. */
void piezo_correct(piezo_axis *axis, piezo_real y_measured);

/* What follows is to be called between two steps, while piezo_learn is at rest. */

/* Go on with another model. What it would drive differently at this moment is added to the drive and multiplied by
 * fade, 0 <= fade < 1, after each sample: exp(-sample time / time constant), 0 to let the drive jump. A model without
 * an inverse is refused, and nothing changes. Learning starts anew from it, and samples and weights that are on their
 * way are dropped. */
piezo_status piezo_set_model(piezo_axis *axis, const piezo_weights *weights, piezo_real fade);

/* Limits of the drive and its largest change from sample to sample, in input units. */
piezo_status piezo_set_limits(piezo_axis *axis, piezo_real low, piezo_real high, piezo_real max_step);

/* Gain of the integral action per second, from 0 to 1 / PIEZO_SAMPLE_TIME_S. */
piezo_status piezo_set_integral_gain(piezo_axis *axis, piezo_real per_second);

/* The states of the actuator, to be carried over a restart of the controller. Learning starts anew from there. */
void piezo_get_state(const piezo_axis *axis, piezo_state *state);
piezo_status piezo_set_state(piezo_axis *axis, const piezo_state *state);

#ifdef __cplusplus
}
#endif

#endif
