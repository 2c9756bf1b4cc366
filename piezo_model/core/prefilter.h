/* The dynamics of an actuator behind its hysteresis and creep, as its compensator and its learner use them, in three
 * filters of its modes. With the poles D(z) of a mode, and R(z) of the same frequency and well damped, they are
 *
 *     reference   F(z) = product over the modes of  D(z) / D(1)  R(1) / R(z),  before the inverse of the model
 *     model       R(1) / R(z) of each mode, behind the amplifier's lag and before the zeros of the stage: the output
 *                 that the stage should have, against which integral action takes the error
 *     sensor      F(z) again, behind the measurement: the learner's y is that of a static actuator whose drive is late
 *                 by the lag of all of it
 *
 * References and outputs are in the units of the structure, drives and states of the operators in normalised ones.
 *
 * A mode's states are q = R(1) / R(z) u and its first difference; the input u determines the second one. D(z) / D(1) q
 * is the output, so q is the modal displacement of the stage: where a limit held the drive, the second difference is
 * set from what the actuator received. In single precision, q(k - 1) and q(k - 2) would lose three digits. All lags are
 * constants of the actuator, so a step takes the same time at every sample.
 */
#ifndef CORE_PREFILTER_H
#define CORE_PREFILTER_H

#include "operators.h"

/* Constants R(1), 1 - r_2, D(1), (1 - d_2) / D(1), 1 / R(1), 1 / D(1) for R(z) = 1 + r_1 / z + r_2 / z^2 and D alike;
 * q, its first difference and the second one at the present sample. */
typedef struct {
    num R, c_R, D, c_D, inverse_R, inverse_D, q, first, second;
} Mode;

/* Constants: the factor by which the amplifier's error decays in a sample; the samples by which the reference and the
 * learner's drive are late, and the fraction of a sample that is interpolated in the learner's output; the samples that
 * are unknown after a bad one; the zeros of the stage.
 *
 * States: the samples still unknown; where the rings are written next. Levels: the amplifier's output in the reference
 * model, the last inputs of the zeros, the last finite reference, the output of F, the last good measurement and what
 * became of it, and the ring of references. Drives: a ring, and the amplifier's output. */
typedef struct {
    num decay, reference_lag, drive_lag, fraction, unknown_lasts, taps[LANES];
    num unknown, reference_at, drive_at, behind, history[LANES], reference, output, measured, filtered, ring[];
} PrefilterMemory;

typedef struct {
    Mode *reference, *model, *sensor; /* of each filter, one after the other */
    PrefilterMemory *memory;
    num *drives;       /* behind the ring of references, s.ring samples */
    num *play, *creep; /* states of the operators before the learner's next drive */
} Prefilter;

enum { LEVELS = LANES + 5 };

CORE_INLINE int mode_nums(Shape s) { return 3 * s.modes * (int)(sizeof(Mode) / sizeof(num)); }
CORE_INLINE int prefilter_nums(Shape s)
{
    const int filter = mode_nums(s) + (int)(sizeof(PrefilterMemory) / sizeof(num)) + 2 * s.ring + 1;
    const int states = (play_vectors(s) + CREEP_VECTORS * creep_vectors(s)) * (LANES / WIDTH);
    return s.ring == 0 ? 0 : NUMS(filter) + states;
}

CORE_INLINE Prefilter prefilter_at(Arena *arena, Shape s)
{
    num *const all = nums(arena, prefilter_nums(s)), *const states = (num *)(void *)arena->at;
    Mode *const modes = (Mode *)(void *)all;
    PrefilterMemory *const memory = (PrefilterMemory *)(void *)(all + mode_nums(s));
    const int creep = CREEP_VECTORS * creep_vectors(s) * (LANES / WIDTH), play = play_vectors(s) * (LANES / WIDTH);
    return (Prefilter){modes,         modes + s.modes,       modes + 2 * s.modes,
                       memory,        memory->ring + s.ring, states - creep - play,
                       states - creep};
}

/* Begin in balance, where `which` is 1, at an output and at these states, of which the first is the drive. */
CORE_API void N(prefilter_balance)(const Prefilter *p, Shape s, num which, num level, const num *play,
                                   const num *creep);
/* The output of the first filter for a finite reference. */
CORE_API num N(reference_filter)(const Prefilter *p, Shape s, num y_ref);
/* Go on to its next sample from the output v, where `which` is 1, instead of its own. */
CORE_API void N(reference_follow)(const Prefilter *p, Shape s, num v, num which);
/* The output that the stage should have for a finite reference. */
CORE_API num N(model_filter)(const Prefilter *p, Shape s, num y_ref);
/* The learner's output of a measured one; `good` becomes 0 where it is not known. */
CORE_API num N(sensor_filter)(const Prefilter *p, Shape s, num y, num *good);
/* The learner's drive of the present one, past which its states of the operators go. */
CORE_API num N(sensor_drive)(const Prefilter *p, Shape s, Operators operators, num x);

#endif
