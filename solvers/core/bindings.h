/* A function that Python calls, and its arguments: a line of a table says what they are, and one function takes them
 * all.
 *
 * BINDINGS(F) lists the functions of a file, each as
 *
 *     F(name, "arguments", "what help() says of it", whether it lasts, call)
 *
 * and MAKE_BINDINGS(file) makes them of it. Arguments are names, separated by ", ", with what each has to be:
 *
 *     name           a number
 *     name#0:9       a whole number from 0 to 9; either bound may be missing
 *     name[n,d]      a float64 array of two dimensions, contiguous in C order; name[n] one of one
 *     name[n]q       one of int64; name[n]i of C's int
 *     name[n]=       one to write to, name[n]? one or None
 *     name@BOX1      a state of the kind 'BOX1'; name@ any block of bytes
 *
 * A size is a number or a letter, dd a product, d+1 a sum. A letter stands for what it met first; a state of a kind
 * gives those of `measure_state` their values, and NEED_SIZE checks what only C can tell. The first argument that does
 * not fit sets Python's error. The call refers to the arguments by their number, the first is 0, and what it puts into
 * WHOLE_RESULT or NUMBER_RESULT is returned, else 0; a Python object may be OBJECT_RESULT. Where the expression `lasts`
 * is not 0, the interpreter may run other threads meanwhile: for what takes longer than some microseconds.
 */
#ifndef CORE_BINDINGS_H
#define CORE_BINDINGS_H

#include "arena.h"
#include "python_abi.h"

enum { MOST_ARGUMENTS = 14 };

typedef union {
    double number;
    int64_t whole;
    void *memory;
} Value;

typedef struct {
    const char *signature;
    Py_ssize_t count;
    int taken, failed, is_number;
    int64_t whole_result;
    double number_result;
    PyObject *object_result;
    PyThreadState *waiting;
    int64_t sizes[26];
    Value values[MOST_ARGUMENTS];
    Py_buffer views[MOST_ARGUMENTS];
} Arguments;

/* A part of a state that Python has a view of: where it begins and how many numbers of eight bytes it has. */
typedef struct {
    const char *name;
    const void *first;
    Py_ssize_t length;
} Part;

/* The signature is name(arguments), of which the arguments begin at a place. */
int take_arguments(Arguments *a, const char *signature, size_t place, PyObject *const *given, Py_ssize_t count);
/* Set the sizes that a state gives; each package has its own (module.c). */
void measure_state(Arguments *a, const void *state);
/* Fail for a reason that the function itself finds; only where `lasts` is 0, since it sets Python's error. */
void refuse(Arguments *a, const char *why);
/* Fail where a block has fewer bytes; whether it does. */
int need_bytes(Arguments *a, int argument, int64_t bytes);
/* Fail where a size is not what it should be; whether it is not. */
int need_size(Arguments *a, int64_t size, int64_t wanted);
/* Return a dictionary of where each part of a state stands, in bytes from its beginning, and its length. */
void return_parts(Arguments *a, const void *state, const Part *parts, size_t count);
/* Give the arrays back; the result, or NULL with Python's error where an argument did not fit. */
PyObject *finish(Arguments *a);

#define NUMBER(i) a.values[i].number
#define WHOLE(i) a.values[i].whole
#define INT(i) ((int)a.values[i].whole)
#define MEMORY(i) a.values[i].memory
#define REALS(i) ((double *)a.values[i].memory)
#define WHOLES(i) ((int64_t *)a.values[i].memory)
#define SIZE_OF(a, letter) (a)->sizes[#letter[0] - 'a']
#define LENGTH(letter) SIZE_OF(&a, letter)
#define SIZE(letter) ((int)LENGTH(letter))
#define NEED_BYTES(i, bytes) need_bytes(&a, i, bytes)
#define NEED_SIZE(letter, wanted) need_size(&a, LENGTH(letter), wanted)
#define RETURN_PARTS(state, parts) return_parts(a, state, parts, sizeof parts / sizeof *parts)
#define WHOLE_RESULT a.whole_result
#define OBJECT_RESULT a.object_result
#define NUMBER_RESULT a.is_number = 1, a.number_result

#define BINDING_FUNCTION(name, arguments, text, lasts, call)                                                           \
    static PyObject *enter_##name(PyObject *module, PyObject *const *given, Py_ssize_t count)                          \
    {                                                                                                                  \
        Arguments a;                                                                                                   \
        (void)module;                                                                                                  \
        if (take_arguments(&a, #name "(" arguments ")", sizeof #name, given, count)) {                                 \
            a.waiting = (lasts) ? PyEval_SaveThread() : NULL;                                                          \
            if (!a.failed) {                                                                                           \
                call;                                                                                                  \
            }                                                                                                          \
        }                                                                                                              \
        return finish(&a);                                                                                             \
    }
#define BINDING_METHOD(name, arguments, text, lasts, call)                                                             \
    {#name, (PyCFunction)(void (*)(void))enter_##name, METH_FASTCALL, #name "(" arguments "): " text},
#define MAKE_BINDINGS(file)                                                                                            \
    BINDINGS(BINDING_FUNCTION)                                                                                         \
    extern PyMethodDef file##_bindings[];                                                                              \
    PyMethodDef file##_bindings[] = {BINDINGS(BINDING_METHOD){NULL, NULL, 0, NULL}};

#endif
