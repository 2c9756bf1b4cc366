/* Replays samples with the step in one thread and the learner in another one.
 *
 *     two_threads IN OUT DELAY SEED
 *
 * The learner is delayed at random by up to DELAY samples; with 0 it is always in time. The step waits for a learner
 * that is later than that. Standard output has the counts of events, the number of changes of weights in the step, and
 * the number of changes to weights that were never offered.
 */
#include "piezo.c"

#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>

enum { NUMBERS = 1024, MOST = 20000 };

int offered(void *learner, double *inverse); /* the last weights offered, their inverse, and the number of offers */

static piezo_axis axis;
static double offers[MOST][NUMBERS], taken[MOST][NUMBERS];
static long now, until, learned, ended; /* the learner waits for sample `until` */
static int offer_count;
static long longest;
static unsigned seed;

static long get(long *p) { return __atomic_load_n(p, __ATOMIC_ACQUIRE); }
static void set(long *p, long value) { __atomic_store_n(p, value, __ATOMIC_RELEASE); }
static unsigned draw(void) { return seed = seed * 1664525U + 1013904223U, seed >> 8; }

static void *learn(void *unused)
{
    (void)unused;
    while (!get(&ended)) {
        if (!piezo_learn(&axis)) {
            sched_yield();
            continue;
        }
        const int count = offered(axis.learner.bytes, offers[offer_count]);
        offer_count += count > offer_count && offer_count < MOST - 1;
        set(&learned, learned + 1);
        if (longest > 0 && draw() % 8 == 0) {
            set(&until, get(&now) + (long)draw() % longest);
            while (get(&now) < until && !get(&ended)) {
                sched_yield();
            }
        }
    }
    return NULL;
}

int main(int count, char **words)
{
    FILE *file = count > 4 ? fopen(words[1], "rb") : NULL;
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        return 2;
    }
    const long steps = ftell(file) / (long)sizeof(double) / 2;
    double *const in = malloc((size_t)steps * 2 * sizeof *in), *const out = malloc((size_t)steps * sizeof *out);
    rewind(file);
    if (in == NULL || out == NULL || fread(in, sizeof *in, 2 * (size_t)steps, file) != 2 * (size_t)steps) {
        return 2;
    }
    fclose(file);
    longest = atol(words[3]);
    seed = (unsigned)atoi(words[4]);

    piezo_reset(&axis);
    const Compensator c = of(&axis);
    const size_t size = (size_t)inverse_nums(c.shape) * sizeof(double);
    int changes = 0, torn = 0;
    pthread_t learner;
    memcpy(taken[0], c.inverse.w_H, size);
    if (size > sizeof taken[0] || pthread_create(&learner, NULL, learn, NULL) != 0) {
        return 2;
    }
    for (long k = 0; k < steps; ++k) {
        while (get(&learned) + (long)piezo_get_events(&axis).dropped_blocks < k / PIEZO_BLOCK - 1 && k > get(&until)) {
            sched_yield();
        }
        out[k] = piezo_step(&axis, in[2 * k], in[2 * k + 1]);
        set(&now, k);
        if (memcmp(taken[changes], c.inverse.w_H, size) != 0 && changes < MOST - 1) {
            memcpy(taken[++changes], c.inverse.w_H, size);
        }
    }
    set(&ended, 1);
    pthread_join(learner, NULL);
    for (int i = 1; i <= changes; ++i) {
        int found = 0;
        for (int j = 0; j < offer_count; ++j) {
            found = found || memcmp(taken[i], offers[j], size) == 0;
        }
        torn += !found;
    }
    const piezo_events e = piezo_get_events(&axis);
    printf("%u %u %u %u %d %d\n", e.hand_overs, e.refusals, e.late_offers, e.dropped_blocks, changes, torn);
    file = fopen(words[2], "wb");
    if (file == NULL || fwrite(out, sizeof *out, (size_t)steps, file) != (size_t)steps || fclose(file) != 0) {
        return 2;
    }
    free(in);
    free(out);
    return 0;
}
