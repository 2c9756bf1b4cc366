/* The learner's interface to the step, always in double precision: condition numbers of 1e4 to 1e8 leave no digits in
 * single precision. */
#ifndef PIEZO_LEARNER_H
#define PIEZO_LEARNER_H

/* Initialise the learner. The mailbox that it shares with the step begins HEAD_BYTES (core/arena.h) after its start. */
void piezo_learner_reset(void *learner);
/* Begin to learn from these weights (w_H0 ..., w'_S ..., w_K ..., offset). */
void piezo_learner_begin(void *learner, const double *weights);

#endif
