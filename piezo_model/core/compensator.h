/* The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample,
 *
 *     x(k) = H^-1[ S^-1[y_r](k) - K(k) - offset ](k).
 *
 * It keeps the states of the model, H and K: what it returns after saturation and rate limits is what the actuator really sees,
 * and that is what moves them on. Those of H^-1 follow from them at every sample. Whatever the reference is, NaN and infinity
 * included, the drive is finite and inside its limits.
 *
 * Source: the paper's equation (8); K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_COMPENSATOR_H
#define CORE_COMPENSATOR_H

#include "operators.h"

enum { COMPENSATOR_KIND = 0x434f4d31 };

/* Centres and scales of the structure, limits of the drive in the input unit and, with its largest change, unit amplitudes. */
typedef struct {
    real x_centre, x_scale, y_centre, y_scale, low, high, unit_low, unit_high, max_step;
} DriveLimits;

/* What is still added to the drive since the last change of model, the factor by which it decays from sample to sample, and the
 * last finite reference in the output unit. */
typedef struct {
    real bump, decay, last_y_ref;
} Fade;

/* Integral action on what a sensor says: the share of each error that is added to the reference from then on, 0 for none; what has
 * been added so far, in the output unit; the last reference as it was given, NaN where there was none; and 1 or -1 where the drive
 * for it was above or below what the limits let pass. */
typedef struct {
    real gain, correction, given, held;
} Feedback;

typedef struct {
    ShapedHead *head;
    Shape shape;
    Operators operators;
    Superposition S_inverse;
    real *w_H, *W_H;                  /* weights of H and their partial sums, the slopes of H */
    real *w_H_inverse, *r_H_inverse;  /* of H^-1 */
    real *w_K;                        /* for every creep state, rate by rate */
    real *weights;                    /* all of them: w_H0 ... w_Hn, w'_S, w_K, offset */
    DriveLimits *limits;
    Fade *fade;
    Feedback *feedback;
    real *play, *creep;
} Compensator;

CORE_API int64_t compensator_bytes(Shape shape);
CORE_API Compensator compensator_at(void *memory);
/* Make a block of compensator_bytes(shape) bytes a compensator; limits, thresholds and states are still to be written. */
CORE_API void compensator_setup(void *memory, Shape shape);
/* Invert the model of these weights; they must be those of a valid model. */
CORE_API void compensator_take(Compensator *c, const real *weights);
/* Take the output that the last drive produced: correction <- correction + gain (y_r - y). With the inverse in front the actuator is
 * about 1, so that a disturbance comes through by |1 - z^-1| / |1 - (1 - gain) z^-1|, at most 2 / (2 - gain). Anti-windup: an error is not
 * added up that pushes the drive further beyond a limit, and all of them never make more than half the output's range. */
CORE_API void compensator_correct(Compensator *c, real y);
/* Drive in the input unit for a reference in the output unit; one that is not finite holds the drive where it is. */
CORE_API real compensator_step(Compensator *c, real y_ref);
/* What it would drive for the last reference at this moment, in unit amplitudes; nothing is moved on. */
CORE_API real compensator_now(const Compensator *c);
/* Take new weights over without a bump: what they would drive differently at this moment is added and fades away. */
CORE_API void compensator_hand_over(Compensator *c, const real *weights);

#endif
