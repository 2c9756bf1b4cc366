/* A bank of self-learning compensators of one structure, eight actuators to a tile, one in each lane.
 *
 * Every number of a tile is eight of them, one an actuator: nothing ever crosses lanes, so a sensor that fails hurts its own actuator
 * only. The compensator is that of compensator.h, to the last bit. The learner is that of continuous.h by blocks: a sample leaves
 * nothing but drive and output; at the end of a block the rows of the error model (5) are made from them, from the states of the operators at
 * its beginning, and added to the Gram matrix at once,
 *
 *     G <- lambda^B G + (1 - lambda) sum over k of lambda^(B-1-k) row_k row_k',   row = (Xi, x),
 *
 * so that rows never leave the first-level cache and G is read once a block. An interval is a whole number of blocks. At its end comes the
 * exact optimum, which is a candidate for one interval and then takes the place of the weights in use if it has predicted at least as
 * well. A tile begins at a sample of its own within the interval, so that optima are spread over the samples.
 */
#ifndef CORE_BANK_H
#define CORE_BANK_H

#include "box.h"
#include "box_lanes.h"
#include "operators.h"

enum { BANK_KIND = 0x42414e4b, BANK_BLOCK = 32 };

/* Samples of a block, an interval, between checkpoints, of a reset and of half a window of excitation; lambda and the share of the
 * diagonal of the proximal term; the factor by which a bump decays; the smoothing factor of the error's level; the smallest slope. */
typedef struct {
    int64_t block, interval, checkpoint, reset_lasts, half_window, middle;
    real forgetting, proximal, decay, smoothing, min_slope, max_step, x_centre, x_scale, y_centre, y_scale;
} BankSettings;

typedef struct {
    ShapedHead shaped;
    int64_t tiles;
} BankHead;

typedef struct {
    BankHead *head;
    Shape shape;
    int d;
    BankSettings *settings;
    real *r, *a;                                        /* of play, and of creep by rates */
    real *zone_low, *zone_high, *outer_low, *outer_high; /* as in regressors.h */
    char *drivers, *learners, *notes; /* the three parts of the tiles, each of all tiles in turn: what every sample, a block, a fault needs */
} Bank;

/* Samples so far, with those that the tile began late; samples that wait for their block to be full; whether there has been a drive. */
typedef struct {
    int64_t sample, waiting, started;
} TileCounts;

/* What is gone back to after a fault. */
typedef struct {
    real *gram, *in_use, *level;
} TileNote;

/* What a learner remembers beside vectors, a number of each lane; flags are 0 or 1. See continuous.h for the words. */
enum {
    LEARNING, LEFT, PROBATION, LEVEL, SQUARES_IN_USE, SQUARES_CANDIDATE, PREDICTED, ESTABLISHED, NOTED, REVERT, WAIT, IN_HALF,
    LOW, HIGH, LOW_BEFORE, HIGH_BEFORE, LAST_X, LAST_Y, WAY, X_LOWEST, X_HIGHEST, HAND_OVERS, REFUSALS, FAULTS, ALONE, MEMORY_LENGTH
};

typedef struct {
    int number;
    TileCounts *counts;
    real *play, *creep, *w_H, *W_H, *w_H_inverse, *r_H_inverse, *w_S, *w_K, *offset;
    real *limits; /* lowest and highest drive in the input unit, then in unit amplitudes */
    real *fade;   /* bump and last finite reference */
    real *old_play, *old_creep; /* states before the samples that wait */
    real *memory;               /* MEMORY_LENGTH */
    real *in_use, *candidate;
    real *gram;                 /* triangle(d + 1) */
    real *seen;                 /* drive and output of each sample that waits, unit amplitudes */
    TileNote older, newer;
} Tile;

CORE_API int64_t bank_bytes(Shape shape, int64_t tiles);
/* Room that a step needs, for each thread its own. */
CORE_API int64_t bank_room_bytes(Shape shape);
CORE_API Bank bank_at(void *memory);
CORE_API Tile tile_at(const Bank *b, int64_t tile);
/* Make a block of bank_bytes(shape, tiles) bytes a bank; everything but what follows from the shape is still to be written. */
CORE_API void bank_setup(void *memory, Shape shape, int64_t tiles);
/* Invert the model of the weights of a tile. */
CORE_API void tile_invert(const Bank *b, const Tile *t);
/* Forget what the lanes where `which` is 1 have learned but for the weights in use, `level` being their mean squared error so far. */
CORE_API void tile_begin_anew(const Bank *b, const Tile *t, vec8 which, vec8 level);
/* Step the tiles from `first` up to `last`: take the outputs (samples, 8 tiles) that the drives before each sample produced, and drive
 * for these references; all in the units of the structure. */
CORE_API void bank_step(const Bank *b, int64_t first, int64_t last, const real *y_ref, const real *y, real *x, int64_t samples, void *room);

#endif
