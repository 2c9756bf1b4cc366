/* Cyclic operation, a synchronous Moore machine:   reset -> build -> learn -> reset, with the new weights.
 *
 *     reset    only the operators move on                                         over after so many good samples without a fault
 *     build    good samples are counted into the data basis                       over after so many of them
 *     learn    one step w <- Proj(w - eta (P w + q)) a sample, or waiting for     over after so many samples
 *              the answer of a solver that is not one of steps
 *
 * The operators follow the actuator in every phase; reset clears P, q and c and never the states. A fault of the sensor sends the
 * machine to reset.
 *
 * Nothing is kept back: new weights are those of all the data, and data that came before have a part in them. With V the mean cost
 * of this cycle's data, V_p that of the cycles before, and w the weights in use, what is solved and what is remembered are
 *
 *     (V + b V_p) / (1 + b),   b = RECALL min(V(w) / V_p(w), V_p(w) / V(w))
 *
 * the one with the w that learning begins with, the other, which takes the place of V_p, with those that it ends with. A cycle that
 * covers other amplitudes or places than the last one does not undo it, but data at odds with each other, a sensor that was zeroed
 * anew or a reference gone wild, are forgotten at once. A cycle whose drive covers less than NARROW of what V_p covers is not
 * remembered, for small movements would lead astray what they hardly excite; but each takes a tenth off what V_p is said to cover.
 *
 * New weights are taken over if the drive of the building phase went through at least MIN_EXCITATION of its range, and if they are
 * finite and explain what they were learned from no worse than those in use: that is what a solver can have done wrong. What the
 * drive did not reach stays as it was, since the problem's reference are the weights in use.
 *
 * Source: the paper's Fig. 1 and equations (3) to (7).
 */
#ifndef CORE_CYCLIC_H
#define CORE_CYCLIC_H

#include "data_basis.h"
#include "descent.h"
#include "learning.h"

enum { CYCLIC_KIND = 0x43594331 };

/* Lengths of the phases in samples; strength of the proximal term, smallest slope, step as a share of the stability limit; whether
 * learning is by steps, and else samples until the answer of `answer` is looked at, at least one. */
typedef struct {
    int64_t reset_lasts, build_lasts, learn_lasts, steps;
    real proximal, min_slope, step_ratio;
} CyclicSettings;

typedef struct {
    LearningCounts counts;
    CyclicSettings settings;
    Scales scales;
    SensorGuard guard;
    int64_t middle, learning_since; /* index of the slope about zero; the sample that learning began at */
    real error_in_use, error_found; /* at the last hand-over or refusal, RMS in unit amplitudes */
    real past_share;                /* of the drive's range that the cycles before cover, 0 where there are none */
} CyclicMemory;

typedef struct {
    ShapedHead *head;
    CyclicMemory *memory;
    Shape shape;
    int d, ld;
    real *in_use, *reference, *found; /* unknowns: of the weights in use, the same when learning began, and what it found */
    real *weights;          /* the latter as weights of a model */
    real *covered;          /* lowest and highest x, lowest and highest y of the last building phase */
    real *data, *past;      /* mean products of the row (x, Xi), upper triangle by rows: what was learned from, and V_p */
    /* The program 1/2 z'Pz + q'z over lower <= z, in variables v = scale z that make its diagonal one: */
    real *P, *q, *lower, *upper; /* d rows of d numbers; the upper bounds are infinite */
    real *start, *scale, *answer;
    Basis basis;            /* in the unknowns, which are slopes */
    Descent descent;
} Cyclic;

CORE_API int64_t cyclic_bytes(Shape shape);
CORE_API Cyclic cyclic_at(void *memory);
/* Make a block of cyclic_bytes(shape) bytes a learner; settings, scales, thresholds, states and in_use are still to be written, and
 * then cyclic_enter(c, RESET). */
CORE_API void cyclic_setup(void *memory, Shape shape, int middle);
CORE_API void cyclic_enter(Cyclic *c, int phase);
/* Take the output y that the drive x produced, in their units; what it brought. */
CORE_API int cyclic_observe(Cyclic *c, real x, real y);
/* Half the mean squared error of the unknowns v on mean products. */
CORE_API real cyclic_cost(Shape s, const real *data, const real *v);

#endif
