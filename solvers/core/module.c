/* The extension module solvers.core._core. This file is compiled without the instructions of an instruction set, so
 * that it can say what the processor has before anything else of the library runs. */
#include "face_solvers.h"
#include "module.h"

#if defined(__x86_64__) || defined(_M_X64)
#include <cpuid.h>

/* 2, 3 or 4: the level of the x86-64 psABI that processor and operating system offer; 1 where they do not offer
 * level 2. */
static int processor_level(void)
{
    unsigned a, b, c, d, basic, extended = 0, low, high;
    if (!__get_cpuid(1, &a, &b, &basic, &d) || (basic & bit_SSE4_2) == 0 || (basic & bit_POPCNT) == 0) {
        return 1;
    }
    if ((basic & bit_OSXSAVE) == 0 || !__get_cpuid_count(7, 0, &a, &extended, &c, &d)) {
        return 2;
    }
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0)); /* which registers the operating system saves */
    if ((low & 0x06) != 0x06 || (basic & bit_AVX) == 0 || (extended & bit_AVX2) == 0 || (extended & bit_BMI2) == 0
        || (basic & bit_FMA) == 0) {
        return 2;
    }
    c = bit_AVX512F | bit_AVX512BW | bit_AVX512CD | bit_AVX512DQ | bit_AVX512VL;
    return (low & 0xe6) == 0xe6 && (extended & c) == c ? 4 : 3;
}
#else
static int processor_level(void) { return 0; }
#endif

FACE(processor_level) { return finish_integer(a, processor_level()); }

FACES(ENTER_FACE)
static PyMethodDef methods[] = {
    FACES(METHOD){NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {
    {{1, NULL}, NULL, 0, NULL},
    "_core",
    "Solvers in C; see the headers in solvers/core.",
    -1,
    methods,
    NULL,
    NULL,
    NULL,
    NULL,
};

PyObject *PyInit__core(void) { return make_module(&definition); }
