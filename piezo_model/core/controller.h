/* The step of a self-learning compensator, an interrupt of constant time: sensor guard, integral action, offers that
 * are due, drive. The sample goes into a block for the learner. */
#ifndef CORE_CONTROLLER_H
#define CORE_CONTROLLER_H

#include "mailbox.h"
#include "sensor_guard.h"

typedef struct {
    Compensator compensator;
    Mailbox mailbox;
} Controller;

/* Begin anew, while the learner rests: a new epoch, a first block from these states, a reset sensor guard. */
CORE_API void N(controller_begin)(const Controller *c, const num *play, const num *creep);
/* Begin a block with the operator states before its first sample. */
CORE_API void N(controller_begin_block)(const Controller *c, const num *play, const num *creep);
/* Process the output y of the unit drive x; 1 if the block is full. The next block must be begun before the next
 * sample.
 */
CORE_API int N(controller_observe)(const Controller *c, num x, num y);
/* The drive for a reference. After a full block it begins the next one and takes weights that are due. */
CORE_API num N(controller_drive)(const Controller *c, num y_ref);

#endif
