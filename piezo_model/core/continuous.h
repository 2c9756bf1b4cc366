/* Continuous operation, the paper's outlook: the data basis is updated, and the weights with it, in real time.
 *
 *     reset   nothing is learned; the squared error (5) of the weights in use is summed up
 *     learn   P <- lambda P + Xi Xi', q <- lambda q + Xi x and the optimum after that (swept.h)
 *
 * Every interval the weights that are one interval old take the place of those in use if they have predicted the interval at least as
 * well. They are admissible, since the solver keeps them in their box. They are handed over only while the drive of the last one to
 * two half windows went through a part of its range that says enough. Otherwise learning pauses too, once there has been a hand-over,
 * and nothing is forgotten: the memory would fade and the noise of the sensor take its place.
 *
 * Nothing learned before a fault of the sensor is lost, and nothing learned from a sensor about to fail is kept:
 *
 * - at a fault solver and weights go back to a state noted at least one checkpoint ago, and learning waits until samples have been
 *   good for as long as a reset lasts;
 * - if the weights in use predicted these samples about as well as before the fault, it goes on from there;
 * - otherwise sensor or actuator are not what they were: learning begins anew, and new weights are handed over once they have learned
 *   for a half window without another fault. The noted state is kept until then, since a sensor that was gone may come back.
 */
#ifndef CORE_CONTINUOUS_H
#define CORE_CONTINUOUS_H

#include "learning.h"
#include "swept.h"

enum { CONTINUOUS_KIND = 0x434f4e54 };

/* Samples of a reset, between hand-overs, between checkpoints (a multiple of that) and in half a window of excitation; the smoothing
 * factor of the error's level; the smallest slope. */
typedef struct {
    int64_t reset_lasts, interval, checkpoint, half_window;
    real smoothing, min_slope;
} ContinuousSettings;

typedef struct {
    LearningCounts counts;
    ContinuousSettings settings;
    Scales scales;
    SensorGuard guard;
    int64_t middle;              /* index of the slope about zero */
    int64_t in_half, predicted;  /* samples in this half window; samples predicted in this interval */
    int64_t established;         /* whether weights have been handed over since learning began anew */
    int64_t excited;             /* whether the drive says enough */
    int64_t revert;              /* whether the candidate comes into use at the end of the interval whatever it predicts */
    int64_t wait;                /* samples still to be learned from before any hand-over */
    int64_t noted, has_fallback; /* states noted, at most two; whether there is one to fall back on */
    real squares_in_use, squares_candidate; /* of the errors in this interval */
    real level, probation;       /* mean squared error of the weights in use; its sum since the last fault */
    real low, high, low_before, high_before; /* of the drive in this half window and the one before */
} ContinuousMemory;

/* What is gone back to after a fault. */
typedef struct {
    void *swept; /* swept_kept_bytes(d) bytes */
    real *in_use, *level;
} Checkpoint;

typedef struct {
    ShapedHead *head;
    ContinuousMemory *memory;
    Shape shape;
    int d, ld; /* unknowns, and 1 more rounded up to a multiple of eight */
    Regressors regressors; /* of the unknowns, which are slopes */
    real *play, *creep;
    real *row;                  /* (x, Xi, x), so that (x, Xi) and (Xi, x) are both there */
    real *in_use, *candidate;   /* (1, v): the product with a row is the error (5) */
    real *weights, *lower, *upper;
    real *span;                 /* lowest and highest drive, lowest and highest output since the last look at them or fault */
    Checkpoint noted[2], fallback;
    Swept swept;
} Continuous;

CORE_API int64_t continuous_bytes(Shape shape);
CORE_API Continuous continuous_at(void *memory);
/* Make a block of continuous_bytes(shape) bytes a learner that forgets by lambda a sample and holds what the data leave open with the
 * share `proximal` of the mean diagonal, with at most so many exchanges a sample (0 for any number). Settings, scales, thresholds, states and in_use are still to be written, and then
 * continuous_begin_anew(c, 0). */
CORE_API void continuous_setup(void *memory, Shape shape, int middle, real min_slope, double forgetting, double proximal, int most_exchanges);
/* Forget everything but the weights in use, `level` being their mean squared error so far. */
CORE_API void continuous_begin_anew(Continuous *c, real level);
CORE_API void continuous_enter(Continuous *c, int phase);
/* Take the output y that the drive x produced, in their units; what it brought. */
CORE_API int continuous_observe(Continuous *c, real x, real y);

#endif
