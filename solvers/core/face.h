/* A function that Python calls and its arguments: taken in order, checked, and given back together.
 *
 * The first argument that does not fit sets Python's error; the takers after it do nothing and return NULL or 0, so
 * that one look at `good(&a)` suffices. Arrays come through the buffer protocol and nothing else: contiguous in C
 * order, of the type that the function wants, with the shape that it wants. README.md in this folder says how to add a
 * function.
 */
#ifndef CORE_FACE_H
#define CORE_FACE_H

#include "python_abi.h"

enum { MOST_ARRAYS = 12, ANY_LENGTH = -1, VECTOR = -2 };

typedef struct {
    const char *signature;
    PyObject *const *given;
    Py_ssize_t count, next;
    int arrays, failed;
    PyThreadState *waiting;
    Py_buffer views[MOST_ARRAYS];
} Arguments;

/* Every state that Python holds begins so: what it is, its number of variables and its size in bytes. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
} StateHead;

/* A header lists the functions of a package as FACES(F), each as F(name, how many arguments it takes, their names, what
 * help() says of it); a face_*.c has their bodies, FACE(name) { ... }, and module.c the table. */
#define FACE(name) PyObject *face_##name(Arguments *a)
#define DECLARE_FACE(name, wanted, arguments, text) FACE(name);

/* take_name(a): the argument as a state of this kind, as name_at makes it; all zero for an error. */
#define TAKE_STATE(name, type, kind)                                                                                   \
    static type take_##name(Arguments *a)                                                                              \
    {                                                                                                                  \
        static const type none;                                                                                        \
        void *const memory = take_state(a, kind);                                                                      \
        return memory != NULL ? name##_at(memory) : none;                                                              \
    }

void take_arguments(Arguments *a, const char *signature, PyObject *const *given, Py_ssize_t count, Py_ssize_t wanted);
int good(const Arguments *a);

/* The next argument. */
long long take_integer(Arguments *a, long long least, long long most);
double take_number(Arguments *a);
/* A float64 array (rows, columns), (columns,) where rows is VECTOR, any number of either where it is ANY_LENGTH; NULL
 * for an error. */
const double *take_array(Arguments *a, Py_ssize_t rows, Py_ssize_t columns);
double *take_output(Arguments *a, Py_ssize_t rows, Py_ssize_t columns);
/* The same, or NULL without an error where the argument is None. */
const double *take_optional(Arguments *a, Py_ssize_t rows, Py_ssize_t columns);
/* An array (length,) of int64 to write to, and of C's int. */
int64_t *take_integers(Arguments *a, Py_ssize_t length);
int *take_ints(Arguments *a, Py_ssize_t length);
/* A state of the given kind; with kind 0 any block, to be made one once `need_bytes` has found it large enough. */
void *take_state(Arguments *a, int32_t kind);
/* Whether array number `array` (0 is the first taken) has so many bytes. */
void need_bytes(Arguments *a, int array, int64_t bytes);
/* Fail for a reason that the function itself finds. */
void refuse(Arguments *a, const char *why);
/* Length of the array taken last, along its first axis. */
Py_ssize_t taken_length(const Arguments *a);

/* Between these two the interpreter may run other threads; for what takes longer than some microseconds. */
void begin_long_if(Arguments *a, int long_enough);
void end_long(Arguments *a);
/* Give the arrays back and return `result`; NULL with Python's error where an argument did not fit. */
PyObject *finish(Arguments *a, PyObject *result);
PyObject *finish_integer(Arguments *a, long long result);
PyObject *finish_number(Arguments *a, double result);

/* A part of a state that Python has a view of: where it begins and how many numbers of eight bytes it has. */
typedef struct {
    const char *name;
    const void *first;
    Py_ssize_t length;
} Part;

/* The same with a dictionary of where each part of a state stands, in bytes from its beginning, and its length. */
PyObject *finish_parts(Arguments *a, const void *state, const Part *parts, size_t count);

#endif
