/* The stage behind the controller. piezo_stage.c holds a simulated one, and is the file to write for your own. */
#ifndef PIEZO_STAGE_H
#define PIEZO_STAGE_H

typedef struct {
    double low, high;  /* limits of the drive */
    double rate_limit; /* its largest change, per second */
    double rest;       /* where it is before and after a run */
} piezo_stage_limits;

extern const piezo_stage_limits piezo_stage;

/* Get ready; 0, or another number where the stage cannot be used. */
int piezo_stage_open(void);
/* Write the drive x and take what was measured, NAN where nothing was; 0, or another number where the stage failed. */
int piezo_stage_exchange(double x, double *y);
void piezo_stage_close(void);

#endif
