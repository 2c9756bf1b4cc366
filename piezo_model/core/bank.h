/* A bank of self-learning compensators of one structure, eight actuators to a tile, one in each lane.
 *
 * A tile is a controller and a learner of eight (num.h): the very text of the single ones, in which nothing crosses
 * lanes, so a sensor that fails hurts its own actuator only. One thread steps a tile and lets it learn, in one call. A
 * tile begins at a sample of its own within the interval, so that optima are spread over the samples.
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
        *notes; /* the three parts of the tiles, each of all tiles in turn: what every sample, a block, a fault needs */
} Bank;

CORE_API int64_t bank_bytes(Shape shape, int64_t tiles, int block);
/* Arena that a step needs, for each thread its own. */
CORE_API int64_t bank_workspace_bytes(Shape shape, int block);
CORE_API Bank bank_at(void *memory);
/* What a tile consists of; `workspace` is of the thread that lets it learn. */
CORE_API Controller tile_controller(const Bank *b, int64_t tile);
CORE_API Learner tile_learner(const Bank *b, int64_t tile, void *workspace);
/* Make a block of bank_bytes(...) bytes a bank; settings, thresholds, limits and states are still to be written. */
CORE_API Bank bank_setup(void *memory, Shape shape, int64_t tiles, int block);
/* Prepare a new tile, whose samples are counted from `late` on. */
CORE_API void tile_prepare(const Bank *b, int64_t tile, int64_t late);
/* Make the lanes of a tile where `which` is 1 begin to learn anew from the weights that stand in it. */
CORE_API void tile_begin(const Bank *b, int64_t tile, num which);
/* Step the tiles from `first` up to `last`: take the outputs (samples, 8 tiles) that the drives before each sample
 * produced, and drive for these references; all in the units of the structure. */
CORE_API void bank_step(const Bank *b, int64_t first, int64_t last, const real *y_ref, const real *y, real *x,
                        int64_t samples, void *workspace);

#endif
