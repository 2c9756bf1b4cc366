/* What begins both extension modules: their table's entries, and the module with what its library was built from.
 *
 * It is here and inline, since module.c alone is compiled for every processor.
 */
#ifndef CORE_MODULE_H
#define CORE_MODULE_H

#include "face.h"

#define ENTER_FACE(name, wanted, arguments, text)                                                                      \
    static PyObject *enter_##name(PyObject *module, PyObject *const *given, Py_ssize_t count)                          \
    {                                                                                                                  \
        Arguments a;                                                                                                   \
        (void)module;                                                                                                  \
        take_arguments(&a, #name "(" arguments ")", given, count, wanted);                                             \
        return face_##name(&a);                                                                                        \
    }
#define METHOD(name, wanted, arguments, text)                                                                          \
    {#name, (PyCFunction)(void (*)(void))enter_##name, METH_FASTCALL, #name "(" arguments "): " text},

PY_EXPORT PyObject *PyInit__core(void);

static PyObject *make_module(PyModuleDef *definition)
{
    PyObject *const module = PyModule_Create2(definition, PYTHON_ABI_VERSION);
    if (module != NULL
        && (PyModule_AddStringConstant(module, "sources", CORE_SOURCES) != 0
            || PyModule_AddStringConstant(module, "compiler", CORE_COMPILER) != 0
            || PyModule_AddStringConstant(module, "instructions", CORE_INSTRUCTIONS) != 0)) {
        return NULL;
    }
    return module;
}

#endif
