/* The monotonic clock, for figures that hold no call from Python. One reading costs some 20 ns and is part of the
 * figure. */
#ifndef CORE_CLOCK_H
#define CORE_CLOCK_H

#include <stdint.h>

int64_t monotonic_ns(void);

#endif
