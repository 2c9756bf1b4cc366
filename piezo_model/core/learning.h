/* What both ways of learning have in common: phases, counts, what a sample brings, and the unknowns that are learned.
 *
 * The unknowns v are the weights w of the error model (5) with w_H0 = 1, but for S^-1, whose 2 m + 1 weights are replaced by its
 * slopes, their partial sums outwards from the piece about zero: then the admissible set is a box. A learner keeps states of the
 * operators of its own and knows nothing of the compensator: it is told drive and output, and says when `weights` are to be taken over.
 */
#ifndef CORE_LEARNING_H
#define CORE_LEARNING_H

#include "regressors.h"
#include "sensor_guard.h"

#define MIN_EXCITATION ((real)0.02) /* smallest share of the drive's range that new weights may come from */

enum { RESET, BUILD, LEARN };

/* What a sample brought; several at once are possible. piezo_model/learning/events.py has the same names. */
enum {
    TAKE_OVER = 1,       /* the weights in `weights` are to be taken over now */
    SENSOR_FAULT = 2,    /* the sensor cannot be trusted: learning goes back and waits */
    PROGRAM = 4,         /* cyclic: a program is there, for whoever solves it */
    UNEXCITED = 8,       /* cyclic: the drive went through too little of its range */
    NOT_A_NUMBER = 16,   /* cyclic: the weights found are not finite */
    WORSE = 32,          /* cyclic: they explain the data worse than those in use */
    CYCLE_OVER = 64,     /* cyclic: with or without new weights */
    FIRST = 128,         /* continuous: the first weights since learning began anew */
    LOOK = 256,          /* continuous: time to look at the range that was driven */
    OTHER_SENSOR = 512,  /* continuous: after a fault the output is not what it was, learning began anew */
    NO_OPTIMUM = 1024    /* continuous: the data have none, learning began anew */
};

/* Samples left in the phase, samples so far, how often what happened, and the verdict on the last sample; `failures`
 * are those of arithmetic. */
typedef struct {
    int64_t phase, left, sample, hand_overs, refusals, faults, failures, verdicts[4], last_verdict;
} LearningCounts;

/* Of input and output; unit amplitudes are (x - centre) / scale. */
typedef struct {
    real x_centre, x_scale, y_centre, y_scale;
} Scales;

/* A part of a state for a struct. */
CORE_INLINE void *room_for(Room *room, size_t bytes)
{
    void *const first = room->at;
    room->at += room_bytes((int64_t)bytes);
    return first;
}

/* All weights of a model, w_H0 = 1 first, from the unknowns v; `middle` is the slope about zero among the slopes. */
CORE_INLINE void weights_of(Shape s, int middle, const real *v, real *weights)
{
    const real *const slopes = v + s.n;
    weights[0] = 1;
    memcpy(weights + 1, v, sizeof(real) * (size_t)(unknowns(s) - s.offset));
    for (int i = 0; i < s.zones; ++i) {
        const real inner = i > middle ? slopes[i - 1] : i < middle ? slopes[i + 1] : 0;
        weights[s.n + 1 + i] = slopes[i] - inner;
    }
    weights[weight_count(s) - 1] = s.offset ? v[unknowns(s) - 1] : 0;
}

/* The unknowns v of the weights of a model. */
CORE_INLINE void unknowns_of(Shape s, int middle, const real *weights, real *v)
{
    real *const slopes = v + s.n;
    for (int j = 0; j < unknowns(s); ++j) {
        v[j] = weights[j + 1] / weights[0];
    }
    for (int i = middle + 1; i < s.zones; ++i) {
        slopes[i] += slopes[i - 1];
    }
    for (int i = middle - 1; i >= 0; --i) {
        slopes[i] += slopes[i + 1];
    }
}

/* The lower bounds of the unknowns: 0, the smallest slope, and none for the constant. */
CORE_INLINE void lower_bounds(Shape s, real min_slope, real *lb)
{
    for (int j = 0; j < unknowns(s); ++j) {
        lb[j] = j >= s.n && j < s.n + s.zones ? min_slope : 0;
    }
    if (s.offset) {
        lb[unknowns(s) - 1] = -REAL_INFINITY;
    }
}

#endif
