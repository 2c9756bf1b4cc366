/* The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample,
 *
 *     x(k) = H^-1[ S^-1[y_r](k) - K(k) - offset ](k).
 *
 * With dynamics y_r first passes their inverse (prefilter.h).
 *
 * Its state consists of the operator states of the model, H and K, advanced by the drive after saturation and rate
 * limit, which the actuator receives. The states of H^-1 follow from them at every sample. For any reference, NaN and
 * infinity included, the drive is finite and inside its limits.
 *
 * Source: the paper's equation (8); K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_COMPENSATOR_H
#define CORE_COMPENSATOR_H

#include "prefilter.h"

enum { COMPENSATOR_KIND = 0x434f4d32 };

#define BEYOND ((real)1e30) /* an end that no dead zone reaches, and that a file may hold */

/* Settings that all compensators of one structure share: centres and scales; the largest change of the drive for each
 * sample in normalised units; the factor by which a transfer bump decays for each sample; and the share of an error
 * that integral action adds to the reference, 0 for none. */
typedef struct {
    real x_centre, x_scale, y_centre, y_scale, max_step, decay, gain;
} DriveSettings;

/* State of the drive: its limits in the input unit and in normalised units; the transfer bump, which is added to
 * the drive after a change of weights; the last finite reference with the correction, and the correction of integral
 * action, both in the output unit; `target`, which the output is compared with, NaN before the first drive;
 * `saturated`, 1 or -1 where the limits kept the drive below or above the wanted one; and the index of the next eight
 * creep states to flush. */
typedef struct {
    num low, high, unit_low, unit_high, bump, last_y_ref, correction, target, saturated, turn;
} DriveMemory;

/* The weights of a model, w_H0 ... w_Hn, w'_S, w_K and the constant; the partial sums W_H of w_H; weights and
 * thresholds of H^-1; with dynamics weights and dead zones of S, the inverse of S^-1. */
typedef struct {
    num *w_H, *w_S, *w_K, *offset, *W_H, *w_H_inverse, *r_H_inverse, *w_S_inverse, *low, *high;
} Inverse;

typedef struct {
    Shape shape;
    const DriveSettings *settings;
    Operators operators;
    real *low, *high; /* of the dead zones */
    DriveMemory *memory;
    num *play, *creep;
    Inverse inverse;
    Prefilter prefilter;
} Compensator;

CORE_INLINE int inverse_nums(Shape s)
{
    return 4 * NUMS(s.n + 1) + (s.ring == 0 ? 1 : 4) * NUMS(s.zones) + NUMS(creep_weights(s)) + NUMS(1);
}

CORE_INLINE Inverse inverse_at(Arena *arena, Shape s)
{
    Inverse p;
    p.w_H = nums(arena, NUMS(s.n + 1));
    p.w_S = nums(arena, NUMS(s.zones));
    p.w_K = nums(arena, NUMS(creep_weights(s)));
    p.offset = nums(arena, NUMS(1));
    p.W_H = nums(arena, NUMS(s.n + 1));
    p.w_H_inverse = nums(arena, NUMS(s.n + 1));
    p.r_H_inverse = nums(arena, NUMS(s.n + 1));
    p.w_S_inverse = nums(arena, s.ring == 0 ? 0 : NUMS(s.zones));
    p.low = nums(arena, s.ring == 0 ? 0 : NUMS(s.zones));
    p.high = nums(arena, s.ring == 0 ? 0 : NUMS(s.zones));
    return p;
}

/* Compute S from S^-1 of the dead zones from `low` and `high` on, outwards from the middle on either side: a piece of
 * slope W that begins at r and u has the slope 1 / W in S and begins at u. */
CORE_INLINE void invert_superposition(const Inverse *p, Shape s, const real *low, const real *high)
{
    int middle = 0;
    while (high[middle] > 0) { /* infinite below zero */
        ++middle;
    }
    p->w_S_inverse[middle] = divided(constant(1), p->w_S[middle]);
    for (int side = -1; side <= 1; side += 2) {
        const real *const r = side < 0 ? low : high;
        num W = p->w_S[middle], u = constant(0);
        for (int i = middle + side; i >= 0 && i < s.zones; i += side) {
            const num W_before = W;
            u = plus_times(u, W, constant(r[i] - r[i - side]));
            W = plus(W, p->w_S[i]);
            p->w_S_inverse[i] = minus(divided(constant(1), W), divided(constant(1), W_before));
            p->low[i] = side < 0 ? u : constant(-BEYOND);
            p->high[i] = side < 0 ? constant(BEYOND) : u;
        }
    }
}

/* Compute W_H and H^-1 from the weights in p of a valid model, and S with dynamics; r are the thresholds. */
CORE_INLINE void invert(const Inverse *p, Shape s, const real *r, const real *low, const real *high)
{
    num W = p->w_H[0], r_inverse = constant(0);
    p->W_H[0] = W;
    p->w_H_inverse[0] = divided(constant(1), W);
    for (int i = 1; i <= s.n; ++i) {
        const num W_before = W, w = p->w_H[i];
        r_inverse = plus_times(r_inverse, W, constant(r[i] - r[i - 1])); /* the sum by parts */
        W = plus(W, w);
        p->W_H[i] = W;
        p->w_H_inverse[i] = divided(minus(constant(0), w), times(W, W_before));
        p->r_H_inverse[i] = r_inverse;
    }
    if (s.ring > 0) {
        invert_superposition(p, s, low, high);
    }
}

/* New weights, and 1 for the actuators that take them. */
typedef struct {
    Inverse inverse;
    num which;
} Change;

/* Drive in the input unit for a reference in the output unit; one that is not finite holds the drive. New weights are
 * taken without a transfer bump: the change that they cause at this sample is subtracted and decays. */
CORE_API num N(compensator_step)(const Compensator *c, num y_ref, const Change *change);
/* Integral action on the output of the last drive: correction <- correction + gain (y_r - y) where `trusted`. Behind
 * the inverse the actuator has a gain of about 1, so that a disturbance is multiplied by |1 - z^-1| / |1 - (1 - gain)
 * z^-1|, at most 2 / (2 - gain). Anti-windup: errors that push the drive further beyond a limit are ignored, and the
 * correction is at most half the output's range. */
CORE_API void N(compensator_correct)(const Compensator *c, num y, num trusted);
/* Begin from the present states where `which` is 1, with dynamics in balance. The next output, of no drive, does not
 * move the correction. */
CORE_API void N(compensator_balance)(const Compensator *c, num which);
/* The drive for the last reference at this moment, in normalised units; no state changes. */
CORE_API num N(compensator_now)(const Compensator *c);

#ifndef CORE_TILE
CORE_API int64_t compensator_bytes(Shape shape);
CORE_API Compensator compensator_at(void *memory);
/* Initialise compensator_bytes(shape) bytes; the caller sets settings, limits, thresholds and states. */
CORE_API Compensator compensator_setup(void *memory, Shape shape);
/* Invert the valid model of these weights, w_H0 ... w_Hn, w'_S, w_K, offset. */
CORE_API void compensator_set_weights(const Compensator *c, const real *weights);
#endif

/* The unknowns v of all weights of a model. */
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

#endif
