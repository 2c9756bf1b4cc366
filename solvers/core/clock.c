#ifndef _WIN32
#define _POSIX_C_SOURCE 200809L
#include <time.h>
#include "clock.h"

/* The clock of time.perf_counter_ns on Linux and macOS. */
int64_t monotonic_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}
#else
#include <windows.h>
#include "clock.h"

/* Its resolution is 100 ns on most machines. */
int64_t monotonic_ns(void)
{
    LARGE_INTEGER now, frequency;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&frequency);
    return now.QuadPart / frequency.QuadPart * 1000000000
           + now.QuadPart % frequency.QuadPart * 1000000000 / frequency.QuadPart;
}
#endif
