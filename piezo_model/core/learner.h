/* The learner of a compensator, a background task of its step: it computes rows of the error model (5) from a block of
 * samples, their Gram matrix, its optimum, and judges the optimum on later samples before it offers it.
 *
 * The unknowns v are the weights w of (5) with w_H0 = 1, where the 2 m + 1 weights of S^-1 are replaced by its slopes,
 * their partial sums outwards from the piece about zero: the admissible set is then a box. Operation is *continuous*
 * (continuous.c), with a forgetting Gram matrix and an optimum at every interval, or *cyclic* (cyclic.c), the paper's
 * machine of phases.
 *
 * Bad samples have rows of zeros. A block with a sensor fault is not learned from.
 */
#ifndef CORE_LEARNER_H
#define CORE_LEARNER_H

#include "box.h"
#include "descent.h"
#include "mailbox.h"
#include "regressors.h"

#define MIN_EXCITATION ((real)0.02) /* smallest share of its range that the drive must cover for new weights */

enum { RESET, BUILD, LEARN };

/* Events of a block, as flags. piezo_model/learning/events.py has the same names. */
enum {
    TAKE_OVER = 1,      /* weights are offered */
    SENSOR_FAULT = 2,   /* sensor fault: learning falls back and waits */
    PROGRAM = 4,        /* a program is ready for a solver */
    UNEXCITED = 8,      /* cyclic: the drive covered too little of its range */
    NOT_A_NUMBER = 16,  /* cyclic: the weights found are not finite */
    WORSE = 32,         /* cyclic: the weights found explain the data worse than those in use */
    CYCLE_OVER = 64,    /* cyclic: a cycle ended, with or without new weights */
    FIRST = 128,        /* continuous: first weights since learning began anew */
    CHECK_RANGE = 256,  /* continuous: the driven range should be checked */
    OTHER_SENSOR = 512, /* continuous: the sensor changed in a fault, learning began anew */
    NO_OPTIMUM = 1024,  /* continuous: the data have no optimum, learning began anew */
    REVERSED = 2048     /* the output falls as the input rises: no weights are handed over */
};

enum { CONTINUOUS, CYCLIC };     /* values of `mode` */
enum { EXACT, STEPS, ANSWERED }; /* values of `solver`: exact, a projected step for each sample, or external */
/* Constants in an exported folder, so that unused code is not compiled. */
#ifdef CORE_MODE
#define MODE(settings) CORE_MODE
#define SOLVER(settings) CORE_SOLVER
#else
#define MODE(settings) (settings)->mode
#define SOLVER(settings) (settings)->solver
#endif

/* Times in samples, blocks, intervals and checkpoints multiples of each other. */
typedef struct {
    int64_t mode, solver, middle;              /* the last is the index of the slope about zero */
    int64_t interval, checkpoint, half_window; /* continuous */
    int64_t reset_lasts, build_lasts, learn_lasts, solve_lasts;
    real forgetting, row_weight, proximal, min_slope; /* a sample; of a row in the Gram matrix; of the diagonal */
    real smoothing, step_ratio;                       /* of the error's level; of the projected step */
} LearnerSettings;

/* Sums of squares whose quotient is the variance of the noise (noise.c): of third differences, and of slopes. */
enum { SQUARES, SLOPES, NOISE };
/* A span is the lowest and highest drive, then the lowest and highest output. */
enum { X_LOW, X_HIGH, Y_LOW, Y_HIGH, SPAN };
/* Evidence of the direction: sums over the samples of the present stretch, the faded ones of the stretches before it
 * (direction.h), and the verdict: 1 the output rises with the input, -1 it falls, 0 not known yet. */
enum { ONE, X, Y, X_X, X_Y, Y_Y, MOMENTS, COUNT = MOMENTS, STRETCHES, XX, XY, YY, DIRECTION, EVIDENCE };

/* State of a learner; flags are 1 or 0. piezo_model/learning/settings.py has the same names. */
typedef struct {
    num learning;
    num reset_remaining;                              /* samples left of the reset; 0 while learning */
    num probation;                                    /* sum of squared errors during the reset */
    num level;                                        /* mean squared error of the weights in use */
    num squares_in_use, squares_candidate, predicted; /* this interval: sums of squared errors, samples */
    num established;                                  /* flag: weights have been handed over */
    num has_checkpoint;                               /* flag: a checkpoint exists */
    num revert;                                       /* flag: offer the candidate without judging it */
    num wait;                                         /* samples to learn from before the next hand-over */
    num pending;                                      /* flag: the last offer may not have been taken */
    num fault_count;                                  /* sensor faults seen */
    num in_half;                                      /* samples in the current half window */
    num drive[2], drive_before[2]; /* lowest and highest drive of the current half window and of the one before */
    num hand_overs, refusals, faults, failures; /* counters; a failure is a program without an optimum */
    num reversed;                               /* refusals because the output falls as the input rises */
    num span[SPAN];                             /* span since the last fault or range check */
    num evidence[EVIDENCE];
    num stretch[2 * SPAN]; /* spans of the present stretch, and of all */
    num recent[3];         /* last errors (5) of the weights in use, the newest first; NaN for a bad sample */
} LearnerMemory;

/* State that all learners of a tile share. */
typedef struct {
    int64_t next_interval;          /* sample that ends the current interval */
    int64_t phase, phase_left;      /* cyclic */
    int64_t learning_since;         /* cyclic: sample at which learning began */
    real error_in_use, error_found; /* cyclic: RMS errors at the last judgement */
    real past_span;                 /* cyclic: share of the drive's range that the past data cover */
} LearnerClock;

/* A checkpoint, restored after a sensor fault. */
typedef struct {
    num *gram, *in_use, *level;
} Checkpoint;

/* Scratch memory of one thread. */
typedef struct {
    num *rows, *play, *creep;
    Inverse inverse;
    real *P, *q, *lb, *ub, *start; /* the program of one learner */
    real *noise;                   /* contribution of noise to the diagonal of P */
    void *solver;                  /* the state of box.h */
} Workspace;

#ifndef CORE_TILE
/* State of cyclic operation alone: see cyclic.c. */
typedef struct {
    num *reference, *learned;      /* unknowns in use when learning began, and those that it ends with */
    num *start_play, *start_creep; /* operator states at the first sample of the building phase */
    num *covered;                  /* span of the last building phase */
    num *data, *past;              /* mean Gram matrices: of the current program, and of V_p */
    /* The program 1/2 z'Pz + q'z over lower <= z, in variables v = scale z that make its diagonal one: */
    num *P, *q, *lower, *upper; /* d rows of d numbers; the upper bounds are infinite */
    num *start, *scale, *answer;
    ProjectedGradient descent;
} Cyclic;
#endif

typedef struct {
    Shape shape;
    int d;
    const LearnerSettings *settings;
    Regressors regressors; /* of the unknowns, which are slopes */
    Mailbox mailbox;
    LearnerClock *clock;
    LearnerMemory *memory;
    num *in_use, *before, *candidate;       /* the unknowns in use, in use before the last offer, and the next ones */
    num *gram;                              /* of rows (Xi, x) */
    num *pieces, *noise;                    /* n of each piece, and s and t (noise.c); they follow gram */
    Checkpoint checkpoint, next_checkpoint; /* the one that faults restore, and the one after it */
    void *workspace;
#ifndef CORE_TILE
    Cyclic cyclic;
#endif
} Learner;

/* Summary of a block. */
typedef struct {
    int count;
    int64_t end;                           /* number of the first sample after it */
    num good;                              /* number of good samples */
    num fault;                             /* flag: the sensor failed */
    num squares_in_use, squares_candidate; /* sums of squared errors */
    num span[SPAN];                        /* of the good samples */
} BlockSummary;

/* Empty `count` entries of spans where `which` is 1. */
CORE_INLINE void span_clear(num *span, int count, num which)
{
    for (int i = 0; i < count; i += 2) {
        set_where(which, span + i, constant(REAL_INFINITY));
        set_where(which, span + i + 1, constant(-REAL_INFINITY));
    }
}
/* Widen a span by another one where `which` is 1. */
CORE_INLINE void span_widen(num *span, const num *by, num which)
{
    for (int i = 0; i < SPAN; i += 2) {
        set_where(which, span + i, lowest(by[i], span[i]));
        set_where(which, span + i + 1, greatest(by[i + 1], span[i + 1]));
    }
}

/* Size of the data: the Gram matrix, and the contribution of noise to it. */
CORE_INLINE int data_nums(Shape s) { return symmetric_nums(unknowns(s) + 1) + NUMS(s.zones) + NUMS(NOISE); }
CORE_INLINE int learner_nums(Shape s)
{
    const int d = unknowns(s);
    return NUMS((int)(sizeof(LearnerMemory) / sizeof(num))) + 3 * NUMS(d) + data_nums(s);
}
CORE_INLINE int checkpoint_nums(Shape s) { return data_nums(s) + NUMS(unknowns(s)) + NUMS(1); }
/* Without the room in which the optimum of an interval is found, which cyclic operation has none of. */
CORE_INLINE int64_t rows_nums(Shape s, int block)
{
    return block * row_nums(s) + LANES + NUMS(LANES) + state_nums(s) + inverse_nums(s);
}
CORE_INLINE int64_t workspace_bytes(Shape s, int block, int mode)
{
    const int d = unknowns(s);
    const int64_t optimum = mode == CYCLIC ? 0 : (int64_t)sizeof(real) * (padded(d * d) + 5 * padded(d));
    return arena_bytes((int64_t)sizeof(num) * rows_nums(s, block) + optimum);
}
CORE_INLINE Workspace workspace_at(void *memory, Shape s, int block, int mode)
{
    const int d = unknowns(s);
    Workspace w = {0};
    Arena arena = {memory};
    w.rows = nums(&arena, block * row_nums(s) + LANES);
    w.play = nums(&arena, play_vectors(s) * (LANES / WIDTH));
    w.creep = nums(&arena, creep_vectors(s) * (LANES / WIDTH));
    w.inverse = inverse_at(&arena, s);
    w.solver = (char *)memory + workspace_bytes(s, block, mode);
    if (mode == CYCLIC) {
        return w;
    }
    const ArenaField fields[] = {{&w.P, padded(d * d)}, {&w.q, padded(d)},     {&w.lb, padded(d)},
                                 {&w.ub, padded(d)},    {&w.start, padded(d)}, {&w.noise, padded(d)}};
    LAY_OUT(&arena, fields);
    return w;
}
CORE_INLINE Workspace workspace_of(const Learner *l)
{
    return workspace_at(l->workspace, l->shape, l->mailbox.head->block,
                        WIDTH == 1 ? (int)MODE(l->settings) : CONTINUOUS);
}
/* Lay out what a learner has for itself, and its two checkpoints. */
CORE_API void N(learner_lay_out)(Learner *l, Arena *own, Arena *checkpoints);

/* Begin with the weights that stand in in_use where `which` is 1, in continuous operation after a reset if it `resets`.
 */
CORE_API void N(learner_begin)(const Learner *l, num which, int resets);
CORE_API void N(continuous_begin)(const Learner *l, num which, int resets);
/* Pass over a block. */
CORE_API void N(continuous_pause)(const Learner *l);
/* Learn from the next block, if there is one; its events. */
CORE_API int N(learner_learn)(const Learner *l);
/* Forget everything but the weights in use, `level` being their mean squared error so far. */
CORE_API void N(learner_begin_anew)(const Learner *l, num which, num level);
/* Offer the unknowns `v` where `which` is 1; `fallback` where after a fault. Whether the last offer was answered, so
 * that it could be done. */
CORE_API int N(learner_offer)(const Learner *l, const num *v, num which, num fallback, int64_t due);
/* The variance of the sensor's noise. */
CORE_API num N(noise_variance)(const Learner *l);
/* Sum the squared errors of the weights in use and the candidate over the rows of a block, less those of noise. */
CORE_API void N(noise_judge)(const Learner *l, const Block *block, BlockSummary *b);
/* Add the samples of a judged block where it `learns`. */
CORE_API void N(noise_add)(const Learner *l, const Block *block, num learns);
/* Subtract the contribution of noise from the program of one lane. */
CORE_API void N(noise_subtract)(const Learner *l, const Workspace *w, int lane);
/* Learn from a block in continuous operation. */
CORE_API int N(continuous_block)(const Learner *l, const Block *block, const BlockSummary *b);
/* Find the optimum of an interval, which becomes the candidate; 1 where there is none. */
CORE_API num N(learner_optimum)(const Learner *l, num which);
/* Write that program of one lane to the work space. */
CORE_API void N(learner_program)(const Learner *l, int lane);
CORE_INLINE real lower_bound(const Learner *l, int j)
{
    const Shape s = l->shape;
    return s.offset && j == l->d - 1 ? -REAL_INFINITY : j >= s.n && j < s.n + s.zones ? l->settings->min_slope : 0;
}

#ifndef CORE_TILE
enum { LEARNER_KIND = 0x4c454152 };
/* A single learner: mailbox and all the rest in one state. */
typedef struct {
    ShapedHead shaped;
    int32_t block, blocks, mode;
} LearnerHead;
CORE_API int64_t learner_bytes(Shape shape, int block, int blocks, int mode);
CORE_API Learner learner_at(void *memory);
/* Settings, thresholds and in_use are still to be written, and then learner_begin. */
CORE_API Learner learner_setup(void *memory, Shape shape, int block, int blocks, int mode);
CORE_API int cyclic_block(const Learner *l, const BlockSummary *b);
CORE_API void cyclic_enter(const Learner *l, int phase);
/* Count a refusal of new weights, and begin a cycle anew; `why`. */
CORE_API int learner_refuse(const Learner *l, int why);
CORE_API int64_t cyclic_bytes(Shape shape);
CORE_API Cyclic cyclic_at(Arena *arena, Shape shape);
#endif

#endif
