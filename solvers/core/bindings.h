/* Functions that Python calls: a line of a table declares the arguments of each, and one function parses them all.
 *
 * BINDINGS(F) lists the functions of a file, each as
 *
 *     F(name, "arguments", "text of help()", whether it may take long, call)
 *
 * and MAKE_BINDINGS(file) defines them. Arguments are names, separated by ", ", each with its type:
 *
 *     name           a number
 *     name#0:9       a whole number from 0 to 9; either bound may be missing
 *     name[n,d]      a float64 array of two dimensions, contiguous in C order; name[n] one of one
 *     name[n]q       one of int64; name[n]i of C's int
 *     name[n]=       one to write to, name[n]? one or None
 *     name@BOX1      a state of the kind 'BOX1', which other threads cannot use meanwhile; name@ any block of bytes
 *     name@BANL&     one that threads share, each its part
 *
 * A size is a number or a letter, dd a product, d+1 a sum. The first array with a letter determines its value; a state
 * of a kind sets those of `measure_state`, and NEED_SIZE checks sizes that depend on other data. The first argument
 * that does not fit sets Python's error. The call refers to the arguments by number, from 0, and returns WHOLE_RESULT,
 * NUMBER_RESULT or the Python object OBJECT_RESULT; without one, 0. If the expression `lasts` is not 0, other
 * threads of the interpreter may run meanwhile: for calls that take longer than some microseconds.
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
    int parsed, failed, is_number;
    int owned; /* bit i: argument i is a state of this thread alone */
    int64_t whole_result;
    double number_result;
    PyObject *object_result;
    PyThreadState *waiting;
    int64_t sizes[26];
    Value values[MOST_ARGUMENTS];
    Py_buffer views[MOST_ARGUMENTS];
} Arguments;

/* A field of a state that Python views: its beginning, and its length in numbers of eight bytes. */
typedef struct {
    const char *name;
    const void *first;
    Py_ssize_t length;
} Field;

/* Parse the arguments by the signature name(arguments), which begin at `place`; true if all fit. */
int take_arguments(Arguments *a, const char *signature, size_t place, PyObject *const *objects, Py_ssize_t count);
/* Set the sizes that a state determines; each package has its own (module.c). */
void measure_state(Arguments *a, const void *state);
/* Fail for a reason of the function itself; only if `lasts` is 0, since it sets Python's error. */
void refuse(Arguments *a, const char *why);
/* Fail, and return true, if a block has fewer bytes. */
int need_bytes(Arguments *a, int argument, int64_t bytes);
/* Fail, and return true, if a size is wrong. */
int need_size(Arguments *a, int64_t size, int64_t expected);
/* Return a dictionary of the fields of a state: offset in bytes, and length. */
void return_fields(Arguments *a, const void *state, const Field *fields, size_t count);
/* Let other threads of the interpreter run, if it lasts; they are refused the states of this call. */
void let_others_run(Arguments *a, int lasts);
/* Release the arrays; the result, or NULL with Python's error if an argument did not fit. */
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
#define NEED_SIZE(letter, expected) need_size(&a, LENGTH(letter), expected)
#define RETURN_FIELDS(state, fields) return_fields(a, state, fields, sizeof fields / sizeof *fields)
#define WHOLE_RESULT a.whole_result
#define OBJECT_RESULT a.object_result
#define NUMBER_RESULT a.is_number = 1, a.number_result

#define BINDING_FUNCTION(name, arguments, text, lasts, call)                                                           \
    static PyObject *enter_##name(PyObject *module, PyObject *const *objects, Py_ssize_t count)                        \
    {                                                                                                                  \
        Arguments a;                                                                                                   \
        (void)module;                                                                                                  \
        if (take_arguments(&a, #name "(" arguments ")", sizeof #name, objects, count)) {                               \
            let_others_run(&a, (lasts) != 0);                                                                          \
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
