/* What Python calls of this package: one function a line, with the text that help() shows in module.c. */
#ifndef CORE_FACE_MODEL_H
#define CORE_FACE_MODEL_H

#include "face.h"
#include "shape.h"

#define FACE(name) PyObject *name(PyObject *module, PyObject *const *given, Py_ssize_t count)

FACE(face_play);
FACE(face_creep);
FACE(face_dead_zone);
FACE(face_model_bytes);
FACE(face_model_setup);
FACE(face_model_simulate);
FACE(face_basis_bytes);
FACE(face_basis_setup);
FACE(face_basis_clear);
FACE(face_basis_update);
FACE(face_basis_advance);
FACE(face_basis_gram);
FACE(face_basis_rows);
FACE(face_compensator_bytes);
FACE(face_compensator_setup);
FACE(face_compensator_take);
FACE(face_compensator_hand_over);
FACE(face_compensator_now);
FACE(face_compensator_correct);
FACE(face_compensator_step);
FACE(face_compensator_run);
FACE(face_cyclic_bytes);
FACE(face_cyclic_setup);
FACE(face_cyclic_enter);
FACE(face_cyclic_observe);
FACE(face_cyclic_drive);
FACE(face_continuous_bytes);
FACE(face_continuous_setup);
FACE(face_continuous_begin_anew);
FACE(face_continuous_observe);
FACE(face_continuous_drive);
FACE(face_guard_judge);
FACE(face_bank_bytes);
FACE(face_bank_room_bytes);
FACE(face_bank_setup);
FACE(face_bank_begin);
FACE(face_bank_run);
/* Simulated actuators and stages, each beside its Python file. */
FACE(face_log_creep);
FACE(face_bouc_wen);
FACE(face_plays_and_creep);
FACE(face_relay_lines);
FACE(face_charge);
FACE(face_deviation);
FACE(face_structure_response);

/* n, zones, rates and offset, four arguments. */
Shape take_shape(Arguments *a);
/* The size of a state of the shape that is given, as Python asks for it. */
PyObject *size_for(int64_t (*bytes)(Shape), const char *signature, PyObject *const *given, Py_ssize_t count);
enum { MOST_OPERATORS = 10000 };

#endif
