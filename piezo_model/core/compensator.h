/* The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample,
 *
 *     x(k) = H^-1[ S^-1[y_r](k) - K(k) - offset ](k).
 *
 * It keeps the states of the model, H and K: what it returns after saturation and rate limits is what the actuator
 * really sees, and that is what moves them on. Those of H^-1 follow from them at every sample. Whatever the reference
 * is, NaN and infinity included, the drive is finite and inside its limits.
 *
 * Source: the paper's equation (8); K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_COMPENSATOR_H
#define CORE_COMPENSATOR_H

#include "operators.h"

enum { COMPENSATOR_KIND = 0x434f4d32 };

/* What all compensators of one structure share: centres and scales, the largest change of the drive a sample in unit
 * amplitudes, the factor by which a bump decays a sample, and the share of an error that integral action adds to the
 * reference, 0 for none. */
typedef struct {
    real x_centre, x_scale, y_centre, y_scale, max_step, decay, gain;
} DriveSettings;

/* Of each: limits of the drive in the input unit and in unit amplitudes; what is still added to the drive since the
 * last change of weights; the last finite reference with what integral action has added to it so far, both in the
 * output unit; the last reference as it was given, NaN where there was none; 1 or -1 where the drive for it was above
 * or below what the limits let pass; and which eight creep states are looked through next for what has faded. */
typedef struct {
    num low, high, unit_low, unit_high, bump, last_y_ref, correction, given, held, turn;
} DriveMemory;

/* The weights of a model, w_H0 ... w_Hn, w'_S, w_K and the constant; the partial sums W_H of w_H; weights and
 * thresholds of H^-1. */
typedef struct {
    num *w_H, *w_S, *w_K, *offset, *W_H, *w_H_inverse, *r_H_inverse;
} Inverse;

typedef struct {
    ShapedHead *head; /* NULL in a tile */
    Shape shape;
    const DriveSettings *settings;
    Operators operators;
    real *low, *high; /* of the dead zones */
    DriveMemory *memory;
    num *play, *creep;
    Inverse inverse;
} Compensator;

CORE_INLINE int inverse_nums(Shape s) { return 4 * NUMS(s.n + 1) + NUMS(s.zones) + NUMS(creep_weights(s)) + NUMS(1); }

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
    return p;
}

/* Find W_H and H^-1 of the weights in p, which must be those of a valid model; r are the thresholds. */
CORE_INLINE void invert(const Inverse *p, Shape s, const real *r)
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
}

/* Weights to be taken over at a sample, and 1 for those that take them. */
typedef struct {
    Inverse inverse;
    num which;
} Change;

/* Drive in the input unit for a reference in the output unit; one that is not finite holds the drive where it is. A
 * change of weights is taken over without a bump: what the new ones would drive differently at this sample is added and
 * fades away. */
CORE_API num N(compensator_step)(const Compensator *c, num y_ref, const Change *change);
/* Take the output that the last drive produced: correction <- correction + gain (y_r - y) where `trusted`. With the
 * inverse in front the actuator is about 1, so that a disturbance comes through by |1 - z^-1| / |1 - (1 - gain) z^-1|,
 * at most 2 / (2 - gain). Anti-windup: an error is not added up that pushes the drive further beyond a limit, and all
 * of them never make more than half the output's range. */
CORE_API void N(compensator_correct)(const Compensator *c, num y, num trusted);
/* What it would drive for the last reference at this moment, in unit amplitudes; nothing is moved on. */
CORE_API num N(compensator_now)(const Compensator *c);

#ifndef CORE_TILE
CORE_API int64_t compensator_bytes(Shape shape);
CORE_API Compensator compensator_at(void *memory);
/* Make a block of compensator_bytes(shape) bytes a compensator; settings, limits, thresholds and states are still to be
 * written. */
CORE_API Compensator compensator_setup(void *memory, Shape shape);
/* Invert the model of all these weights, w_H0 ... w_Hn, w'_S, w_K, offset, which must be those of a valid model. */
CORE_API void compensator_set_weights(const Compensator *c, const real *weights);
#endif

#endif
