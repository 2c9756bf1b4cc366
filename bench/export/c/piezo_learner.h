/* Learning as the compensator sees it, in doubles whatever the compensator has: conditions of 1e4 to 1e8 leave single precision nothing. */
#ifndef PIEZO_LEARNER_H
#define PIEZO_LEARNER_H

/* Begin to learn, from the weights in use (w_H0 ..., w'_S ..., w_K ..., offset) and the states of the operators. */
void piezo_learner_reset(void *learner, const double *weights, const double *play, const double *creep);
/* Take the output y that the drive x produced; 1 where `weights` were written and are to be taken over. */
int piezo_learner_observe(void *learner, double x, double y, double *weights);
/* Whether the output taken last was good. */
int piezo_learner_trusts(void *learner);
/* Hand-overs, refusals, faults of the sensor and of arithmetic. */
void piezo_learner_events(void *learner, long long *counts);

#endif
