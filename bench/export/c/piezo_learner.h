/* Learning as the step sees it, in doubles whatever the step has: conditions of 1e4 to 1e8 leave single precision
 * nothing. */
#ifndef PIEZO_LEARNER_H
#define PIEZO_LEARNER_H

/* Make it: the mailbox, which step and learner share, begins HEAD_BYTES of core/arena.h behind its beginning. */
void piezo_learner_reset(void *learner);
/* Begin to learn from these weights (w_H0 ..., w'_S ..., w_K ..., offset). */
void piezo_learner_begin(void *learner, const double *weights);

#endif
