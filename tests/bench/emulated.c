/* Replays samples on an emulated ARM controller: doubles from standard input, drives as doubles to standard output.
 *
 * It needs no start-up code of a C library; input and output are Linux system calls, which the emulator serves.
 */
#include "piezo.h"

#define COLUMNS (PIEZO_LEARNING ? 2 : 1)

enum { TOGETHER = 64, END = 1, READ = 3, WRITE = 4 };

static piezo_axis axis;

static int ask(int number, int first, void *second, int third)
{
    register int r7 __asm__("r7") = number;
    register int r0 __asm__("r0") = first;
    register void *r1 __asm__("r1") = second;
    register int r2 __asm__("r2") = third;
    __asm__ volatile("svc 0" : "+r"(r0) : "r"(r7), "r"(r1), "r"(r2) : "memory");
    return r0;
}

void _start(void);

void _start(void)
{
    double in[TOGETHER][COLUMNS], out[TOGETHER];
#if PIEZO_LEARNING
    long taken = 0;
#endif
    piezo_reset(&axis);
    for (int got = ask(READ, 0, in, sizeof in); got > 0; got = ask(READ, 0, in, sizeof in)) {
        const int count = got / (int)sizeof in[0];
        for (int k = 0; k < count; ++k) {
#if PIEZO_LEARNING
            out[k] = (double)piezo_step(&axis, (piezo_real)in[k][0], (piezo_real)in[k][1]);
            if (taken > 0 && taken % PIEZO_BLOCK == 0) { /* a block is complete */
                piezo_learn(&axis);
            }
            ++taken;
#else
            out[k] = (double)piezo_step(&axis, (piezo_real)in[k][0]);
#endif
        }
        ask(WRITE, 1, out, count * (int)sizeof out[0]);
    }
    ask(END, 0, out, 0);
}
