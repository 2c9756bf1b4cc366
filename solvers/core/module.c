/* The extension module solvers.core._core. This file is compiled for any x86-64 processor, so that it can detect the
 * instruction set before other functions of the library run. */
#include "module.h"

#if defined(__x86_64__) || defined(_M_X64)
#include <cpuid.h>

/* The x86-64 level that processor and operating system support: 2, 3 or 4; 1 if they do not support level 2. */
static int processor_level(void)
{
    unsigned a, b, c, d, basic, extended = 0, low, high;
    if (!__get_cpuid(1, &a, &b, &basic, &d) || (basic & bit_SSE4_2) == 0 || (basic & bit_POPCNT) == 0) {
        return 1;
    }
    if ((basic & bit_OSXSAVE) == 0 || !__get_cpuid_count(7, 0, &a, &extended, &c, &d)) {
        return 2;
    }
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0)); /* the registers that the operating system saves */
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

#define BINDINGS(F)                                                                                                    \
    F(processor_level, "", "level of the x86-64 instruction set here, 2 to 4; 0 on other processors.", 0,              \
      WHOLE_RESULT = processor_level())
MAKE_BINDINGS(processor)

void measure_state(Arguments *a, const void *state) { SIZE_OF(a, d) = ((const StateHead *)state)->d; }

extern PyMethodDef box_bindings[], descent_bindings[], library_bindings[], daqp_bindings[];

PyObject *PyInit__core(void)
{
    PyMethodDef *const tables[] = {processor_bindings, box_bindings,  descent_bindings,
                                   library_bindings,   daqp_bindings, NULL};
    return make_module(tables);
}
