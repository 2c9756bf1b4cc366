/* The monotonic clock, for times that include no call from Python. They include one reading of it, some 20 ns. */
#ifndef CORE_CLOCK_H
#define CORE_CLOCK_H

#include <stdint.h>

int64_t monotonic_ns(void);

#endif
