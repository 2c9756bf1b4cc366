/* The stage that the controller drives. Replace the simulated one in piezo_stage.c by your own. */
#ifndef PIEZO_STAGE_H
#define PIEZO_STAGE_H

typedef struct {
    double low, high;  /* limits of the drive */
    double rate_limit; /* largest change of the drive, per second */
    double rest;       /* drive before and after a run */
} piezo_stage_limits;

extern const piezo_stage_limits piezo_stage;

/* Connect; not 0 if the stage cannot be used. */
int piezo_stage_open(void);
/* Write the drive x and read the measured output, NAN without one; not 0 if the stage failed. */
int piezo_stage_exchange(double x, double *y);
void piezo_stage_close(void);

#endif
