/* The extension module piezo_model.core._core. */
#include "face_model.h"
#include "module.h"

FACES(ENTER_FACE)
static PyMethodDef methods[] = {
    FACES(METHOD){NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {
    {{1, NULL}, NULL, 0, NULL},
    "_core",
    "Model, data basis and compensator in C; see the headers in piezo_model/core.",
    -1,
    methods,
    NULL,
    NULL,
    NULL,
    NULL,
};

PyObject *PyInit__core(void) { return make_module(&definition); }
