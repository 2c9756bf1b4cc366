/* What Python calls of this package: one function a line, with the text that help() shows in module.c. */
#ifndef CORE_FACE_MODEL_H
#define CORE_FACE_MODEL_H

#include "face.h"
#include "shape.h"

#define FACES(F)                                                                                                       \
    F(play, 4, "x, r, z, out", "play operators over samples; z moves on.")                                             \
    F(creep, 5, "x, r, a, z, out", "creep operators over samples; z moves on.")                                        \
    F(dead_zone, 4, "u, low, high, out", "dead zones over samples.")                                                   \
    F(model_bytes, 4, "n, zones, rates, offset", "size of a model.")                                                   \
    F(model_setup, 6, "state, n, zones, rates, offset, constant", "make a block a model; where its vectors stand.")    \
    F(model_simulate, 5, "state, play, creep, x, y", "outputs for inputs; the states move on.")                        \
    F(basis_bytes, 4, "n, zones, rates, offset", "size of a data basis.")                                              \
    F(basis_setup, 6, "state, n, zones, rates, offset, forgetting",                                                    \
      "make a block a data basis; where its vectors stand.")                                                           \
    F(basis_clear, 1, "state", "forget the rows.")                                                                     \
    F(basis_update, 3, "state, x, y", "count samples.")                                                                \
    F(basis_advance, 2, "state, x", "move the states on and count nothing.")                                           \
    F(basis_gram, 3, "state, rows, gram", "the Gram matrix with the rows that wait; rows is room.")                    \
    F(basis_rows, 4, "state, x, y, rows", "the rows of samples; the states move on.")                                  \
    F(compensator_bytes, 4, "n, zones, rates, offset", "size of a compensator.")                                       \
    F(compensator_setup, 5, "state, n, zones, rates, offset", "make a block a compensator; where its vectors stand.")  \
    F(compensator_take, 2, "state, weights", "invert the model of these weights.")                                     \
    F(compensator_now, 1, "state", "the unit drive for the last reference at this moment.")                            \
    F(compensator_correct, 2, "state, y", "integral action on the output that the last drive produced.")               \
    F(compensator_step, 2, "state, y_ref", "the drive for one reference.")                                             \
    F(compensator_run, 3, "state, y_ref, x", "drives for references.")                                                 \
    F(learner_bytes, 7, "n, zones, rates, offset, block, blocks, way",                                                 \
      "size of a learner; way 0 is continuous, 1 cyclic.")                                                             \
    F(exported_learner_bytes, 8, "n, zones, rates, offset, block, blocks, way, each",                                  \
      "the same with a mailbox of numbers of so many bytes each.")                                                     \
    F(learner_setup, 8, "state, n, zones, rates, offset, block, blocks, way",                                          \
      "make a block a learner; where its parts stand.")                                                                \
    F(learner_begin, 5, "state, compensator, play, creep, resets",                                                     \
      "begin to learn from the weights in use and these states.")                                                      \
    F(learner_begin_anew, 2, "state, level", "forget all but the weights in use.")                                     \
    F(learner_program, 4, "state, P, q, lower", "the program of an interval.")                                         \
    F(learner_quiet, 1, "state", "samples for which the weights in use cannot change.")                                \
    F(learner_restore, 2, "state, other", "become what another learner was.")                                          \
    F(cyclic_enter, 2, "state, phase", "begin a phase, 0 reset, 1 build, 2 learn.")                                    \
    F(learner_step, 5, "state, compensator, y_ref, y, observes", "observe and drive; (drive, what there is to tell).") \
    F(learner_drive, 4, "state, compensator, y_ref, x", "drives until weights may be due.")                            \
    F(learner_observe, 5, "state, compensator, y, x, first", "learn; (samples done, what there is to tell).")          \
    F(learner_replay, 6, "state, compensator, y, y_ref, x, first", "drive and learn; the same.")                       \
    F(guard_judge, 4, "memory, x, y, verdicts", "which samples can be learned from.")                                  \
    F(bank_bytes, 6, "n, zones, rates, offset, tiles, block", "size of a bank.")                                       \
    F(bank_room_bytes, 5, "n, zones, rates, offset, block", "size of the room that each thread needs.")                \
    F(bank_setup, 7, "state, n, zones, rates, offset, tiles, block", "make a block a bank; where its parts stand.")    \
    F(bank_prepare, 3, "state, tile, late", "prepare a new tile whose samples are counted from late on.")              \
    F(bank_restore, 2, "state, other", "become what another bank was.")                                                \
    F(bank_begin, 3, "state, tile, which", "take the weights that stand in a tile and learn anew.")                    \
    F(bank_run, 7, "state, y_ref, y, x, room, first, last", "drives for references, learning from outputs.")           \
    F(log_creep, 5, "u, a, z, u_previous, K", "creep of an actuator.")                                                 \
    F(bouc_wen, 8, "u, A, beta, gamma, n, h, u_before, path", "h along u.")                                            \
    F(plays_and_creep, 9, "u, r, w_H, w_K, a, z_play, z_creep, u_previous, total", "their weighted sum along u.")      \
    F(relay_lines, 8, "u, r, c, sigma, gain, shift, z, total", "sum over lines of relays along u.")                    \
    F(charge, 8, "u, spring, k, f, force, q, u_before, path", "charge along u.")                                       \
    F(deviation, 6, "u, alpha, b, e, u_before, path", "deviation along u.")                                            \
    F(structure_response, 4, "f, F, s, z", "positions while forces are held.")
FACES(DECLARE_FACE)

/* n, zones, rates and offset, four arguments. */
Shape take_shape(Arguments *a);
/* The size of a state of the shape that is given, as Python asks for it. */
PyObject *size_for(int64_t (*bytes)(Shape), Arguments *a);
enum { MOST_OPERATORS = 10000 };

#endif
