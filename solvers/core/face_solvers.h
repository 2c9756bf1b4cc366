/* What Python calls of this package: one function a line, with the text that help() shows. */
#ifndef CORE_FACE_SOLVERS_H
#define CORE_FACE_SOLVERS_H

#include "face.h"

#define FACE(name) PyObject *name(PyObject *module, PyObject *const *given, Py_ssize_t count)

FACE(face_box_bytes);
FACE(face_box_places);
FACE(face_box_setup);
FACE(face_box_take);
FACE(face_box_start);
FACE(face_box_solve);
FACE(face_box_solve_factorised);
FACE(face_box_dual_from);
FACE(face_time_box);
FACE(face_box_follow);
FACE(face_box_many_bytes);
FACE(face_box_many);
FACE(face_projected_follow);
FACE(face_cone_bytes);
FACE(face_cone_setup);
FACE(face_cone_project);
FACE(face_cone_multipliers);
FACE(face_swept_bytes);
FACE(face_swept_places);
FACE(face_swept_setup);
FACE(face_swept_begin);
FACE(face_swept_take);
FACE(face_swept_take_rows);
FACE(face_swept_recover);
FACE(face_swept_refresh);
FACE(face_swept_error);
FACE(face_time_swept);
FACE(face_absorb);
FACE(face_touched);
FACE(face_time_nothing);
FACE(face_descent_bytes);
FACE(face_descent_places);
FACE(face_descent_setup);
FACE(face_descent_take);
FACE(face_descent_start);
FACE(face_descent_answer);
FACE(face_projected_steps);
FACE(face_accelerated_steps);
FACE(face_time_projected);
FACE(face_time_accelerated);

#endif
