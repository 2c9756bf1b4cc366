/* A compensator of hysteresis and creep for a controller, optionally with a learner that identifies its model while it
 * runs.
 *
 * All state is in the caller's piezo_axis; nothing is allocated, and several axes are independent.
 *
 *     static piezo_axis axis;
 *     piezo_reset(&axis);
 *     every PIEZO_SAMPLE_TIME_S:   x = piezo_step(&axis, y_ref);                      alone
 *                                  x = piezo_step(&axis, y_ref, y_measured_before);   with learning
 *     behind it, with learning:    piezo_learn(&axis);
 *
 * where y_measured_before is the output that the last x produced, or NaN without one. The output lags a slow reference
 * by PIEZO_LAG_S, where the model has dynamics.
 *
 * With learning, call the step from an interrupt: it takes nearly the same time at every sample. Call piezo_learn from
 * the main loop, a task of lower priority or another thread, or right after the step. Both may run at the same time, on
 * one core or on coherent ones, without waiting for each other. An axis has one interrupt and one task.
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

/* Weights of a model, normalised units. */
typedef struct {
    piezo_real w_h[PIEZO_THRESHOLDS]; /* play; the first > 0, the others >= 0 */
    piezo_real w_s[PIEZO_ZONES];      /* inverse superposition; sums outwards from the middle > 0 */
#if PIEZO_RATES > 0
    piezo_real w_k[PIEZO_THRESHOLDS]; /* creep, >= 0 */
#endif
    piezo_real offset;
} piezo_weights;

/* States of the operators, normalised units, and of the transition to the last model. */
typedef struct {
    piezo_real play[PIEZO_PLAY]; /* the first, of threshold zero, is the last input */
#if PIEZO_RATES > 0
    piezo_real creep[PIEZO_RATES * PIEZO_PLAY]; /* rate by rate */
#endif
    piezo_real bump, blend;
    piezo_real last_y_ref, correction; /* output unit; the second is the sum of integral action */
#if PIEZO_MODES > 0
    piezo_real modes[9 * PIEZO_MODES]; /* the inverse of the dynamics, output unit */
#endif
} piezo_state;

#if PIEZO_LEARNING
/* Counts since the reset: hand-overs and refusals of new weights (each of them while the output falls as the input
 * rises, which the y_range of the model does not say), faults of sensor and arithmetic, and, because piezo_learn was
 * late, offers of weights after their sample and blocks of samples that found the ring full. */
typedef struct {
    uint32_t hand_overs, refusals, sensor_faults, numeric_faults, late_offers, dropped_blocks;
} piezo_events;

enum { PIEZO_LEARNED = 4 }; /* counters of piezo_learn */
#endif

/* Private to the functions below. */
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

/* Set the exported model and limits, with the actuator settled at PIEZO_X_START, from which the largest change of the
 * drive counts. Call it first. */
void piezo_reset(piezo_axis *axis);

#if PIEZO_LEARNING
/* The interrupt: take the output that the last drive produced, and return the drive for the reference. A reference that
 * is NaN or infinite holds the drive; the drive is always finite and inside its limits. The output moves the integral
 * action, if PIEZO_INTEGRAL_GAIN is not 0 and the guard trusts the sensor, and goes to the learner in blocks of
 * PIEZO_BLOCK samples. */
piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref, piezo_real y_measured_before);

/* The task: learn from one block of samples; 0 if there was none. New weights are taken over PIEZO_BLOCK samples after
 * their block, so the drive does not depend on when the task ran. If the task is later than that, they are taken over
 * with the next block; if PIEZO_BLOCKS are full, samples are lost. Both are counted. */
int piezo_learn(piezo_axis *axis);

/* May be called from anywhere. */
piezo_events piezo_get_events(const piezo_axis *axis);
#else
/* The drive that brings the actuator to the reference. A reference that is NaN or infinite holds the drive; the drive
 * is always finite and inside its limits. */
piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref);
#endif

/* Integral action, if PIEZO_INTEGRAL_GAIN is not 0: take the output that the last drive produced. With learning,
 * piezo_step does it; without, call it before each step if there is a sensor. */
void piezo_correct(piezo_axis *axis, piezo_real y_measured);

/* Limits of the drive and its largest change from sample to sample, in input units. Call it between two steps. */
piezo_status piezo_set_limits(piezo_axis *axis, piezo_real low, piezo_real high, piezo_real max_step);

/* Call the following functions between two steps, while piezo_learn does not run. */

/* Change the model. The difference between both models' drives at this moment is added to the drive and multiplied by
 * blend, 0 <= blend < 1, after each sample: exp(-sample time / time constant), 0 for a jump. So are those of weights
 * that are learned later. A model without an inverse is refused, and nothing changes. Learning restarts from the new
 * model; samples and weights in transit are dropped. */
piezo_status piezo_set_model(piezo_axis *axis, const piezo_weights *weights, piezo_real blend);

/* Gain of the integral action per second, from 0 to PIEZO_LARGEST_GAIN. */
piezo_status piezo_set_integral_gain(piezo_axis *axis, piezo_real per_second);

/* The actuator has settled at this drive, within the limits, from which the largest change of the drive counts.
 * Learning restarts from there. */
piezo_status piezo_settle(piezo_axis *axis, piezo_real x_start);

/* The states of the actuator, to save over a restart of the controller. Learning restarts from them,
 * and the delays of the dynamics begin in balance. */
void piezo_get_state(const piezo_axis *axis, piezo_state *state);
piezo_status piezo_set_state(piezo_axis *axis, const piezo_state *state);

#ifdef __cplusplus
}
#endif

#endif
