#include "face.h"

#include <string.h>

void take_arguments(Arguments *a, const char *signature, PyObject *const *given, Py_ssize_t count, Py_ssize_t wanted)
{
    a->signature = signature;
    a->given = given;
    a->count = count;
    a->next = 0;
    a->arrays = 0;
    a->waiting = NULL;
    a->failed = count != wanted;
    if (a->failed) {
        PyErr_Format(PyExc_TypeError, "%s takes %zd arguments, not %zd", signature, wanted, count);
    }
}

int good(const Arguments *a) { return !a->failed; }

long long take_integer(Arguments *a, long long least, long long most)
{
    long long value;
    if (a->failed) {
        return 0;
    }
    value = PyLong_AsLongLong(a->given[a->next++]);
    if (value == -1 && PyErr_Occurred()) {
        a->failed = 1;
        return 0;
    }
    if (value < least || value > most) {
        a->failed = 1;
        PyErr_Format(PyExc_ValueError, "%s: argument %zd must be from %lld to %lld, not %lld", a->signature, a->next,
                     least, most, value);
        return 0;
    }
    return value;
}

double take_number(Arguments *a)
{
    double value;
    if (a->failed) {
        return 0.0;
    }
    value = PyFloat_AsDouble(a->given[a->next++]);
    if (value == -1.0 && PyErr_Occurred()) {
        a->failed = 1;
    }
    return value;
}

/* The buffer of the next argument; NULL where there is none or it holds something else than `types` of `itemsize`
 * bytes. */
static const Py_buffer *take_buffer(Arguments *a, int flags, const char *types, Py_ssize_t itemsize)
{
    Py_buffer *view = &a->views[a->arrays];
    if (a->failed) {
        return NULL;
    }
    if (PyObject_GetBuffer(a->given[a->next++], view, flags | PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
        a->failed = 1;
        return NULL;
    }
    ++a->arrays;
    if (view->format == NULL || strchr(types, view->format[0]) == NULL || view->format[1] != '\0'
        || view->itemsize != itemsize) {
        a->failed = 1;
        PyErr_Format(PyExc_TypeError, "%s: argument %zd holds numbers of type %s, not %s", a->signature, a->next,
                     view->format ? view->format : "B", types);
        return NULL;
    }
    return view;
}

static void *take_numbers(Arguments *a, int flags, const char *types, size_t itemsize, Py_ssize_t rows,
                          Py_ssize_t columns)
{
    const Py_buffer *view = take_buffer(a, flags, types, (Py_ssize_t)itemsize);
    const int dimensions = rows == VECTOR ? 1 : 2;
    if (view == NULL) {
        return NULL;
    }
    if (view->ndim != dimensions || (columns != ANY_LENGTH && view->shape[dimensions - 1] != columns)
        || (rows >= 0 && view->shape[0] != rows)) {
        a->failed = 1;
        PyErr_Format(PyExc_ValueError, "%s: argument %zd has not the shape that the others ask for", a->signature,
                     a->next);
        return NULL;
    }
    return view->buf;
}

const double *take_array(Arguments *a, Py_ssize_t rows, Py_ssize_t columns)
{
    return take_numbers(a, 0, "d", sizeof(double), rows, columns);
}

double *take_output(Arguments *a, Py_ssize_t rows, Py_ssize_t columns)
{
    return take_numbers(a, PyBUF_WRITABLE, "d", sizeof(double), rows, columns);
}

int64_t *take_integers(Arguments *a, Py_ssize_t length)
{
    return take_numbers(a, PyBUF_WRITABLE, "lq", sizeof(int64_t), VECTOR, length);
}

int *take_ints(Arguments *a, Py_ssize_t length)
{
    return take_numbers(a, PyBUF_WRITABLE, "i", sizeof(int), VECTOR, length);
}

const double *take_optional(Arguments *a, Py_ssize_t rows, Py_ssize_t columns)
{
    if (!a->failed && a->given[a->next] == &_Py_NoneStruct) {
        ++a->next;
        return NULL;
    }
    return take_array(a, rows, columns);
}

void refuse(Arguments *a, const char *why)
{
    if (!a->failed) {
        a->failed = 1;
        PyErr_Format(PyExc_ValueError, "%s: %s", a->signature, why);
    }
}

void need_bytes(Arguments *a, int array, int64_t bytes)
{
    if (!a->failed && a->views[array].len < bytes) {
        a->failed = 1;
        PyErr_Format(PyExc_ValueError, "%s: the state has room for %zd bytes and needs %lld", a->signature,
                     a->views[array].len, (long long)bytes);
    }
}

void *take_state(Arguments *a, int32_t kind)
{
    const Py_buffer *view = take_buffer(a, PyBUF_WRITABLE, "B", 1);
    const StateHead *head;
    if (view == NULL) {
        return NULL;
    }
    head = view->buf;
    if (((uintptr_t)view->buf & 7) != 0 || view->len < (Py_ssize_t)sizeof *head
        || (kind != 0 && (head->kind != kind || view->len < head->bytes))) {
        a->failed = 1;
        PyErr_Format(PyExc_ValueError, "%s: argument %zd is not the state that this function wants", a->signature,
                     a->next);
        return NULL;
    }
    return view->buf;
}

Py_ssize_t taken_length(const Arguments *a) { return a->failed ? 0 : a->views[a->arrays - 1].shape[0]; }

void begin_long_if(Arguments *a, int long_enough) { a->waiting = long_enough ? PyEval_SaveThread() : NULL; }

void end_long(Arguments *a)
{
    if (a->waiting != NULL) {
        PyEval_RestoreThread(a->waiting);
        a->waiting = NULL;
    }
}

static void give_back(Arguments *a)
{
    end_long(a);
    while (a->arrays > 0) {
        --a->arrays;
        PyBuffer_Release(&a->views[a->arrays]);
    }
}

PyObject *finish(Arguments *a, PyObject *result)
{
    give_back(a);
    return a->failed ? NULL : result;
}

PyObject *finish_integer(Arguments *a, long long result)
{
    give_back(a);
    return a->failed ? NULL : PyLong_FromLongLong(result);
}

PyObject *finish_number(Arguments *a, double result)
{
    give_back(a);
    return a->failed ? NULL : PyFloat_FromDouble(result);
}

PyObject *finish_parts(Arguments *a, const void *state, const Part *parts, size_t count)
{
    PyObject *const all = a->failed ? NULL : PyDict_New();
    for (size_t i = 0; all != NULL && i < count; ++i) {
        const Py_ssize_t at = (const char *)parts[i].first - (const char *)state;
        PyObject *const place = Py_BuildValue("(nn)", at, parts[i].length);
        a->failed = a->failed || place == NULL || PyDict_SetItemString(all, parts[i].name, place) != 0;
        Py_DecRef(place);
    }
    return finish(a, all);
}
