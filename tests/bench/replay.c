/* Replays doubles from a file, references or with learning pairs (reference, output measured before), and writes the
 * drives to another; with learning, the events go to standard error.
 *
 *     replay IN OUT
 */
#include "piezo.h"

#include <stdio.h>
#include <stdlib.h>

#define COLUMNS (PIEZO_LEARNING ? 2 : 1)

static piezo_axis axis;

int main(int count, char **words)
{
    FILE *file = count > 2 ? fopen(words[1], "rb") : NULL;
    if (file == NULL) {
        return 2;
    }
    fseek(file, 0, SEEK_END);
    const size_t steps = (size_t)ftell(file) / sizeof(double) / COLUMNS;
    rewind(file);
    double *const in = malloc(steps * COLUMNS * sizeof *in), *const out = malloc(steps * sizeof *out);
    if (in == NULL || out == NULL || fread(in, sizeof *in, steps * COLUMNS, file) != steps * COLUMNS) {
        return 2;
    }
    fclose(file);
    piezo_reset(&axis);
    for (size_t k = 0; k < steps; ++k) {
#if PIEZO_LEARNING
        out[k] = (double)piezo_step(&axis, (piezo_real)in[2 * k], (piezo_real)in[2 * k + 1]);
        piezo_learn(&axis);
#else
        out[k] = (double)piezo_step(&axis, (piezo_real)in[k]);
#endif
    }
    file = fopen(words[2], "wb");
    if (file == NULL || fwrite(out, sizeof *out, steps, file) != steps || fclose(file) != 0) {
        return 2;
    }
#if PIEZO_LEARNING
    const piezo_events events = piezo_get_events(&axis);
    fprintf(stderr, "%u %u %u %u %u %u\n", events.hand_overs, events.refusals, events.sensor_faults,
            events.numeric_faults, events.late_offers, events.dropped_blocks);
#endif
    free(in);
    free(out);
    return 0;
}
