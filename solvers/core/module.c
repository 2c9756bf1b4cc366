/* The extension module solvers.core._core. This file is compiled without the instructions of an instruction set, so that it can say
 * what the processor has before anything else of the library runs. */
#include "face_solvers.h"
#include "module.h"

#if defined(__x86_64__) || defined(_M_X64)
#include <cpuid.h>

/* 2, 3 or 4: the level of the x86-64 psABI that processor and operating system offer; 1 where they do not offer level 2. */
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

static PyObject *face_processor_level(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    Arguments a;
    (void)module;
    take_arguments(&a, "processor_level()", given, count, 0);
    return finish_integer(&a, processor_level());
}

static PyMethodDef methods[] = {
    METHOD(processor_level, "Level of the x86-64 instruction set here, 2 to 4; 0 on other processors."),
    METHOD(box_bytes, "box_bytes(d): size of the state of the exact solver."),
    METHOD(box_places, "box_places(state): where its vectors begin, in numbers."),
    METHOD(box_setup, "box_setup(state, lb, ub): make a block a state; a status."),
    METHOD(box_take, "box_take(state, P, q): new data, None for what stays; a status."),
    METHOD(box_start, "box_start(state, x): begin a warm solve at x; a status."),
    METHOD(box_solve, "box_solve(state, warm): solve; a status."),
    METHOD(box_solve_factorised, "box_solve_factorised(state, warm): solve without the inverse; a status."),
    METHOD(box_dual_from, "box_dual_from(state, sides): solve by the dual method alone; a status."),
    METHOD(time_box, "time_box(state, P, q, warm, x, updates, solves): time both again and again; a status."),
    METHOD(box_follow, "box_follow(state, P, q, rows, forgetting, answers, nanoseconds): solve after each row; a status."),
    METHOD(box_many_bytes, "box_many_bytes(d): size of the room that box_many needs."),
    METHOD(box_many, "box_many(P, q, lb, ub, x, statuses, room, first, last): eight programs at a time; how many were left to the exact solver."),
    METHOD(projected_follow, "projected_follow(state, cone, P, q, rows, forgetting, ratio, steps, answers, nanoseconds): a status."),
    METHOD(cone_bytes, "cone_bytes(rows, coupled): size of the state of a projection."),
    METHOD(cone_setup, "cone_setup(state, A, b, index): make a block a state; a status."),
    METHOD(cone_project, "cone_project(x, cone): project in place; a status."),
    METHOD(cone_multipliers, "cone_multipliers(cone, multipliers): of the last projection."),
    METHOD(swept_bytes, "swept_bytes(d): size of the state of the solver that takes rows."),
    METHOD(swept_places, "swept_places(state): where its vectors begin, in numbers."),
    METHOD(swept_setup, "swept_setup(state, lb, ub, forgetting, row_weight, proximal): make a block a state; a status."),
    METHOD(swept_begin, "swept_begin(state, P, q): start from these data; a status."),
    METHOD(swept_take, "swept_take(state, row): take a row (xi, x) and answer; a status."),
    METHOD(swept_take_rows, "swept_take_rows(state, rows, answers, nanoseconds): take rows and recover where it must be; a status."),
    METHOD(swept_recover, "swept_recover(state): begin anew from the data so far; a status."),
    METHOD(swept_refresh, "swept_refresh(state): make the swept matrix anew; a status."),
    METHOD(swept_error, "swept_error(state): largest violation of the optimality conditions."),
    METHOD(time_swept, "time_swept(state, P, q, nanoseconds): time starts; a status."),
    METHOD(absorb, "absorb(P, q, c, rows, forgetting): take rows into P, q and c."),
    METHOD(touched, "touched(R, l, u, x, tolerance, cold, sense): which rows x touches, as DAQP has it: 1 above, 3 below."),
    METHOD(time_nothing, "time_nothing(lasting, nanoseconds): time steps that wait so many nanoseconds and do nothing else."),
    METHOD(descent_bytes, "descent_bytes(d): size of the state of a gradient method."),
    METHOD(descent_places, "descent_places(state): where its vectors begin, in numbers."),
    METHOD(descent_setup, "descent_setup(state, lb, ub): make a block a state; a status."),
    METHOD(descent_take, "descent_take(state, P, q, ratio, scaled): new data, None for what stays; a status."),
    METHOD(descent_start, "descent_start(state, cone, x): begin at x, at 0 for None."),
    METHOD(descent_answer, "descent_answer(state): write the answer."),
    METHOD(projected_steps, "projected_steps(state, cone, steps, threshold): how many were taken."),
    METHOD(accelerated_steps, "accelerated_steps(state, None, steps, tolerance): how many were taken."),
    METHOD(time_projected, "time_projected(state, cone, x, steps, threshold, nanoseconds): time runs from x."),
    METHOD(time_accelerated, "time_accelerated(state, None, x, steps, tolerance, nanoseconds): time runs from x."),
    {NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {
    {{1, NULL}, NULL, 0, NULL}, "_core", "Solvers in C; see the headers in solvers/core.", -1, methods, NULL, NULL, NULL, NULL,
};

PyObject *PyInit__core(void) { return make_module(&definition); }
