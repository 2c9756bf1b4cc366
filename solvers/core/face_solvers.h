/* What Python calls of this package: one function a line, with the text that help() shows. */
#ifndef CORE_FACE_SOLVERS_H
#define CORE_FACE_SOLVERS_H

#include "face.h"
#include "face_timed.h"

#define FACES(F)                                                                                                       \
    F(processor_level, 0, "", "level of the x86-64 instruction set here, 2 to 4; 0 on other processors.")              \
    F(box_bytes, 1, "d", "size of the state of the exact solver.")                                                     \
    F(box_places, 1, "state", "where its vectors begin, in numbers.")                                                  \
    F(box_setup, 3, "state, lb, ub", "make a block a state; a status.")                                                \
    F(box_take, 3, "state, P, q", "new data, None for what stays; a status.")                                          \
    F(box_start, 2, "state, x", "begin a warm solve at x; a status.")                                                  \
    F(box_solve, 2, "state, warm", "solve; a status.")                                                                 \
    F(box_solve_factorised, 2, "state, warm", "solve without the inverse; a status.")                                  \
    F(box_dual_from, 2, "state, sides", "solve by the dual method alone; a status.")                                   \
    F(factor_bytes, 1, "d", "size of the room that factor_solve needs.")                                               \
    F(factor_solve, 5, "room, free, P, least, x",                                                                      \
      "solve by the factor of P_FF, the right-hand side in column d of P; 1 if every pivot is safe.")                  \
    F(time_box, 2 + TIMED_COUNT, "state, warm, " TIMED, "time updates and solves; a status, and how many.")            \
    F(box_follow, 1 + FOLLOWED_COUNT, "state, " FOLLOWED, "time a solve after each row; a status.")                    \
    F(box_many_bytes, 1, "d", "size of the room that box_many needs.")                                                 \
    F(box_many, 10, "P, q, lb, ub, x, statuses, room, first, last, lanes",                                             \
      "programs one by one or in lanes; how many one by one.")                                                         \
    F(projected_follow, 3 + FOLLOWED_COUNT, "state, ratio, steps, " FOLLOWED, "as box_follow.")                        \
    F(swept_bytes, 1, "d", "size of the state of the solver that takes rows.")                                         \
    F(swept_places, 1, "state", "where its vectors begin, in numbers.")                                                \
    F(swept_setup, 6, "state, lb, ub, forgetting, row_weight, proximal", "make a block a state; a status.")            \
    F(swept_begin, 3, "state, P, q", "start from these data; a status.")                                               \
    F(swept_take, 2, "state, row", "take a row (xi, x) and answer; a status.")                                         \
    F(swept_take_rows, 4, "state, rows, answers, nanoseconds", "take rows and recover where it must be; a status.")    \
    F(swept_recover, 1, "state", "begin anew from the data so far; a status.")                                         \
    F(swept_refresh, 1, "state", "make the swept matrix anew; a status.")                                              \
    F(swept_error, 1, "state", "largest violation of the optimality conditions.")                                      \
    F(time_swept, 1 + TIMED_COUNT, "state, " TIMED, "time starts from new data; a status, and how many.")              \
    F(absorb, 5, "P, q, c, rows, forgetting", "take rows into P, q and c.")                                            \
    F(active_rows, 7, "R, l, u, tolerance, x, cold, sense", "which rows x touches, as DAQP has it: 1 above, 3 below.") \
    F(time_library, 1 + TIMED_COUNT, "addresses, " TIMED, "as time_box.")                                              \
    F(library_follow, 2 + FOLLOWED_COUNT, "addresses, last, " FOLLOWED, "as box_follow.")                              \
    F(time_nothing, 2, "lasting, nanoseconds", "time steps that wait so many nanoseconds and do nothing else.")        \
    F(descent_bytes, 1, "d", "size of the state of a gradient method.")                                                \
    F(descent_places, 1, "state", "where its vectors begin, in numbers.")                                              \
    F(descent_setup, 3, "state, lb, ub", "make a block a state; a status.")                                            \
    F(descent_take, 5, "state, P, q, ratio, scaled", "new data, None for what stays; a status.")                       \
    F(descent_start, 2, "state, x", "begin at x, at 0 for None.")                                                      \
    F(descent_answer, 1, "state", "write the answer.")                                                                 \
    F(projected_steps, 3, "state, steps, tolerance", "how many were taken.")                                           \
    F(accelerated_steps, 3, "state, steps, tolerance", "how many were taken.")                                         \
    F(time_projected, 5 + TIMED_COUNT, "state, ratio, scaled, steps, tolerance, " TIMED, "as time_box.")               \
    F(time_accelerated, 5 + TIMED_COUNT, "state, ratio, scaled, steps, tolerance, " TIMED, "as time_box.")
FACES(DECLARE_FACE)

#endif
