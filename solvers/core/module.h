/* Creation of both extension modules, with their functions and the properties of their build.
 *
 * The code is in this header since only module.c is compiled for every processor.
 */
#ifndef CORE_MODULE_H
#define CORE_MODULE_H

#include "bindings.h"

PY_EXPORT PyObject *PyInit__core(void);

/* The module with the functions of these tables; a NULL ends the list. */
static PyObject *make_module(PyMethodDef *const *tables)
{
    static PyModuleDef definition = {.m_base = {1}, .m_name = "_core", .m_doc = "See README.md.", .m_size = -1};
    PyObject *const module = PyModule_Create2(&definition, PYTHON_ABI_VERSION);
    int failed = module == NULL || PyModule_AddStringConstant(module, "sources", CORE_SOURCES) != 0
                 || PyModule_AddStringConstant(module, "compiler", CORE_COMPILER) != 0
                 || PyModule_AddStringConstant(module, "instructions", CORE_INSTRUCTIONS) != 0;
    for (; !failed && *tables != NULL; ++tables) {
        failed = PyModule_AddFunctions(module, *tables);
    }
    return failed ? NULL : module;
}

#endif
