/* The part of Python's stable ABI (3.11) that the bindings use, declared here so that they build without Python.h.
 *
 * A test compiles these lines after the real Python.h, so that a different declaration is an error, and compares the
 * layout of the structs and the values of the constants.
 */
#ifndef CORE_PYTHON_ABI_H
#define CORE_PYTHON_ABI_H

#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
#define PY_IMPORT extern __declspec(dllimport)
#define PY_EXPORT __declspec(dllexport)
#else
#define PY_IMPORT extern
#define PY_EXPORT __attribute__((visibility("default")))
#endif

#ifndef CORE_PYTHON_ABI_CHECKED_BY_PYTHON_H
typedef struct _object PyObject;
typedef struct _ts PyThreadState;
typedef intptr_t Py_ssize_t;
typedef PyObject *(*PyCFunction)(PyObject *, PyObject *);

typedef struct {
    void *buf;
    PyObject *obj;
    Py_ssize_t len, itemsize;
    int readonly, ndim;
    char *format;
    Py_ssize_t *shape, *strides, *suboffsets;
    void *internal;
} Py_buffer;

typedef struct {
    const char *ml_name;
    PyCFunction ml_meth;
    int ml_flags;
    const char *ml_doc;
} PyMethodDef;

typedef struct PyModuleDef {
    intptr_t m_base[5]; /* the first is a count of references */
    const char *m_name, *m_doc;
    Py_ssize_t m_size;
    PyMethodDef *m_methods;
    void *m_slots, *m_traverse, *m_clear, *m_free;
} PyModuleDef;

enum {
    METH_FASTCALL = 0x0080,
    PyBUF_WRITABLE = 0x0001,
    PyBUF_FORMAT = 0x0004,
    PyBUF_ND = 0x0008,
    PyBUF_C_CONTIGUOUS = 0x0020 | 0x0010 | PyBUF_ND,
    PYTHON_ABI_VERSION = 3
};
#endif

PY_IMPORT PyObject *PyExc_TypeError, *PyExc_ValueError;
PY_IMPORT PyObject _Py_NoneStruct;

int PyObject_GetBuffer(PyObject *object, Py_buffer *view, int flags);
void PyBuffer_Release(Py_buffer *view);
long long PyLong_AsLongLong(PyObject *object);
PyObject *PyLong_FromLongLong(long long value);
double PyFloat_AsDouble(PyObject *object);
PyObject *PyFloat_FromDouble(double value);
PyObject *PyDict_New(void);
int PyDict_SetItemString(PyObject *dictionary, const char *name, PyObject *value);
void Py_DecRef(PyObject *object);
PyObject *Py_BuildValue(const char *format, ...);
PyObject *PyErr_Format(PyObject *exception, const char *format, ...);
PyObject *PyErr_Occurred(void);
PyThreadState *PyEval_SaveThread(void);
void PyEval_RestoreThread(PyThreadState *state);
PyObject *PyModule_Create2(PyModuleDef *definition, int version);
int PyModule_AddFunctions(PyObject *module, PyMethodDef *functions);
int PyModule_AddStringConstant(PyObject *module, const char *name, const char *value);

#endif
