/* The step of a self-learning compensator, an interrupt of constant time: guard, correct, take what is due, drive; the
 * sample goes into a block for the learner. */
#ifndef CORE_CONTROLLER_H
#define CORE_CONTROLLER_H

#include "mailbox.h"
#include "sensor_guard.h"

typedef struct {
    Compensator compensator;
    Mailbox mailbox;
} Controller;

/* Begin anew, while the learner rests: a new epoch, its first block from these states, a guard that has seen nothing.
 */
CORE_API void N(controller_begin)(const Controller *c, const num *play, const num *creep);
/* Begin a block with the states of the operators before the drive of its first sample. */
CORE_API void N(controller_begin_block)(const Controller *c, const num *play, const num *creep);
/* Take the output y that the unit drive x produced; 1 where a block is full. The next one is to be begun before another
 * sample is taken. */
CORE_API int N(controller_observe)(const Controller *c, num x, num y);
/* The drive for a reference. Where a block begins, it is begun, and weights that are due are taken over. */
CORE_API num N(controller_drive)(const Controller *c, num y_ref);

#endif
