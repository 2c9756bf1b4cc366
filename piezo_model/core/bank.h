/* A bank of self-learning compensators of one structure, in tiles of eight actuators, one in each lane.
 *
 * A tile is a controller and a learner compiled for eight numbers (num.h) from the source of the single ones. Lanes are
 * independent, so that a sensor fault affects its own actuator only. One thread steps a tile and runs its learner, in
 * one call. Tiles begin at different samples of the interval, so that their optima are spread over the samples.
 */
#ifndef CORE_BANK_H
#define CORE_BANK_H

#include "controller.h"
#include "learner.h"

enum { BANK_KIND = 0x42414e4c };

typedef struct {
    ShapedHead shaped;
    int64_t tiles;
    int32_t block;
} BankHead;

typedef struct {
    BankHead *head;
    Shape shape;
    DriveSettings *drive_settings;
    LearnerSettings *learner_settings;
    Regressors regressors;
    char *drivers, *learners,
        *checkpoints; /* three arrays with a part of each tile: data of a sample, of a block, of a fault */
} Bank;

CORE_API int64_t bank_bytes(Shape shape, int64_t tiles, int block);
/* Size of the scratch memory that each thread needs. */
CORE_API int64_t bank_workspace_bytes(Shape shape, int block);
CORE_API Bank bank_at(void *memory);
/* Controller and learner of a tile; `workspace` is that of the learner's thread. */
CORE_API Controller tile_controller(const Bank *b, int64_t tile);
CORE_API Learner tile_learner(const Bank *b, int64_t tile, void *workspace);
/* Initialise bank_bytes(...) bytes; the caller sets settings, thresholds, limits and states. */
CORE_API Bank bank_setup(void *memory, Shape shape, int64_t tiles, int block);
/* Prepare a new tile; its first sample has the number `late`. */
CORE_API void tile_prepare(const Bank *b, int64_t tile, int64_t late);
/* Begin to learn anew from their weights in the lanes of a tile where `which` is 1. */
CORE_API void tile_begin(const Bank *b, int64_t tile, num which);
/* Step the tiles from `first` up to `last`: take the outputs (samples, 8 tiles) that the drives before each sample
 * produced, and drive for these references; all in the units of the structure. */
CORE_API void bank_step(const Bank *b, int64_t first, int64_t last, const real *y_ref, const real *y, real *x,
                        int64_t samples, void *workspace);

#endif
