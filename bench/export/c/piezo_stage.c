/* A simulated stage, a gain and one play. Replace the three functions and the limits by those of your hardware. */
#include "piezo_stage.h"

#include "piezo.h"

const piezo_stage_limits piezo_stage = {PIEZO_LOW, PIEZO_HIGH, 100.0 * (PIEZO_HIGH - PIEZO_LOW), PIEZO_X_START};

static double play;

int piezo_stage_open(void)
{
    play = 0.0;
    return 0;
}

int piezo_stage_exchange(double x, double *y)
{
    const double u = (x - PIEZO_X_CENTRE) / PIEZO_X_SCALE;
    play = fmax(fmin(play, u + 0.3), u - 0.3);
    *y = PIEZO_Y_CENTRE + PIEZO_Y_SCALE * (0.7 * u + 0.25 * play);
    return 0;
}

void piezo_stage_close(void) {}
