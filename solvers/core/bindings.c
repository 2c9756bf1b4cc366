#include "bindings.h"

#include <string.h>

/* Set Python's error. */
#define FAIL(a, exception, ...) (a)->failed = PyErr_Format(exception, __VA_ARGS__) == NULL

/* Parse a size of the signature and move *at behind it; -1 if a letter has no value yet. */
static int64_t size_in(const Arguments *a, const char **at)
{
    int64_t size = **at >= 'a';
    int known = 1;
    for (; **at >= '0' && **at <= '9'; ++*at) {
        size = 10 * size + **at - '0';
    }
    for (; **at >= 'a' && **at <= 'z'; ++*at) {
        known &= a->sizes[**at - 'a'] >= 0;
        size *= a->sizes[**at - 'a'];
    }
    for (; **at == '+'; *at += 2) {
        size += (*at)[1] - '0';
    }
    return known ? size : -1;
}

void refuse(Arguments *a, const char *why) { FAIL(a, PyExc_ValueError, "%s: %s", a->signature, why); }

static void refuse_argument(Arguments *a, const char *why)
{
    FAIL(a, PyExc_ValueError, "%s: argument %d %s", a->signature, a->parsed, why);
}

/* Refuse what is no number, or an integer beyond doubles, by the name that ends at `end`; out of the way of calls that
 * fit. */
__attribute__((cold)) static void refuse_number(Arguments *a, const char *end)
{
    char name[32] = "";
    const char *begin = end;
    while (begin[-1] != ' ' && begin[-1] != '(' && end - begin < (ptrdiff_t)sizeof name - 1) {
        --begin;
    }
    memcpy(name, begin, (size_t)(end - begin));
    FAIL(a, PyExc_ValueError, "%s must be a real number, and one that a double can hold", name);
}

static const char *take_number(Arguments *a, PyObject *given, Value *value, const char *at)
{
    value->number = PyFloat_AsDouble(given);
    a->failed = value->number == -1.0 && PyErr_Occurred() != NULL;
    if (a->failed) {
        refuse_number(a, at);
    }
    return at;
}

static const char *take_whole(Arguments *a, PyObject *object, Value *value, const char *at)
{
    const int64_t least = *at == ':' ? INT64_MIN : size_in(a, &at);
    const int64_t most = *++at == ',' || *at == ')' ? INT64_MAX : size_in(a, &at);
    value->whole = PyLong_AsLongLong(object);
    a->failed = value->whole == -1 && PyErr_Occurred() != NULL;
    if (!a->failed && (value->whole < least || value->whole > most)) {
        FAIL(a, PyExc_ValueError, "%s: argument %d must be from %lld to %lld, not %lld", a->signature, a->parsed,
             (long long)least, (long long)most, (long long)value->whole);
    }
    return at;
}

/* The mark of this machine's byte order, which SciPy writes before a type and NumPy does not. */
#define NATIVE (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? '<' : '>')

/* The buffer of an argument, whose entries must have one of `types` and this size. */
static const Py_buffer *take_buffer(Arguments *a, PyObject *object, int flags, const char *types, Py_ssize_t itemsize)
{
    Py_buffer *const view = &a->views[a->parsed - 1];
    a->failed = PyObject_GetBuffer(object, view, flags | PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0;
    const char *const type = a->failed || view->format == NULL ? "B" : view->format + (view->format[0] == NATIVE);
    if (!a->failed
        && (*type == '\0' || strchr(types, *type) == NULL || type[1] != '\0' || view->itemsize != itemsize)) {
        FAIL(a, PyExc_TypeError, "%s: argument %d holds numbers of type %s, not %s", a->signature, a->parsed, type,
             types);
    }
    return a->failed ? NULL : view;
}

static const char *take_array(Arguments *a, PyObject *object, Value *value, const char *at)
{
    const char *mark = strchr(at, ']') + 1;
    const char type = *mark == 'q' || *mark == 'i' ? *mark++ : 'd';
    const int written = *mark == '=', optional = *mark == '?';
    int axis = 0;
    mark += written || optional;
    value->memory = NULL;
    if (optional && object == &_Py_NoneStruct) {
        return mark;
    }
    const Py_buffer *const view = take_buffer(a, object, written ? PyBUF_WRITABLE : 0,
                                              type == 'q'   ? "lq"
                                              : type == 'i' ? "i"
                                                            : "d",
                                              type == 'i' ? 4 : 8);
    if (view == NULL) {
        return mark;
    }
    for (--at; *at != ']'; ++axis) {
        const char letter = *++at;
        const int64_t size = size_in(a, &at);
        if (axis < view->ndim && size < 0) {
            a->sizes[letter - 'a'] = view->shape[axis];
        } else if (axis < view->ndim && view->shape[axis] != size) {
            FAIL(a, PyExc_ValueError, "%s: argument %d: expected length %lld in axis %d, got %zd", a->signature,
                 a->parsed, (long long)size, axis, view->shape[axis]);
        }
    }
    if (!a->failed && axis != view->ndim) {
        FAIL(a, PyExc_ValueError, "%s: argument %d: expected %d axes, got %d", a->signature, a->parsed, axis,
             view->ndim);
    }
    value->memory = view->buf;
    return mark;
}

static const char *take_state(Arguments *a, PyObject *object, Value *value, const char *at)
{
    const Py_buffer *const view = take_buffer(a, object, PyBUF_WRITABLE, "B", 1);
    int32_t kind = 0;
    for (; *at >= '0'; ++at) {
        kind = kind << 8 | *at;
    }
    const int is_shared = *at == '&';
    at += is_shared;
    if (view == NULL) {
        return at;
    }
    value->memory = view->buf;
    const StateHead *const head = view->buf;
    if (kind != 0 && view->len >= (Py_ssize_t)sizeof *head && head->kind == ~kind) {
        refuse_argument(a, "is in use by another thread; give each thread one of its own");
    } else if ((uintptr_t)view->buf % 64 != 0 || view->len < (Py_ssize_t)sizeof *head
               || (kind != 0 && (head->kind != kind || view->len < head->bytes))) {
        refuse_argument(a, "is not the state that this function takes");
    } else if (kind != 0) {
        a->owned |= is_shared ? 0 : 1 << (a->parsed - 1);
        measure_state(a, head);
    }
    return at;
}

static void refuse_count(Arguments *a)
{
    Py_ssize_t expected = strchr(a->signature, '(')[1] != ')';
    for (const char *comma = a->signature; (comma = strstr(comma, ", ")) != NULL; ++comma) {
        ++expected;
    }
    FAIL(a, PyExc_TypeError, "%s takes %zd arguments, not %zd", a->signature, expected, a->count);
}

int take_arguments(Arguments *a, const char *signature, size_t place, PyObject *const *objects, Py_ssize_t count)
{
    const char *at = signature + place;
    memset(a, 0, offsetof(Arguments, sizes));
    memset(a->sizes, -1, sizeof a->sizes);
    a->signature = signature;
    a->count = count;
    while (!a->failed && *at != ')' && a->parsed < count && a->parsed < MOST_ARGUMENTS) {
        PyObject *const object = objects[a->parsed];
        Value *const value = &a->values[a->parsed];
        a->views[a->parsed++].obj = NULL;
        while (*at >= 'A' && *at != '[') { /* the name */
            ++at;
        }
        at = *at == '['   ? take_array(a, object, value, at + 1)
             : *at == '#' ? take_whole(a, object, value, at + 1)
             : *at == '@' ? take_state(a, object, value, at + 1)
                          : take_number(a, object, value, at);
        at += *at == ',' ? 2 : 0;
    }
    if (!a->failed && (*at != ')' || a->parsed < count)) {
        refuse_count(a);
    }
    return !a->failed;
}

int need_bytes(Arguments *a, int argument, int64_t bytes)
{
    if (a->views[argument].len < bytes) {
        FAIL(a, PyExc_ValueError, "%s: the state has room for %zd bytes and needs %lld", a->signature,
             a->views[argument].len, (long long)bytes);
    }
    return a->failed;
}

int need_size(Arguments *a, int64_t size, int64_t expected)
{
    if (size != expected) {
        FAIL(a, PyExc_ValueError, "%s: expected an array of %lld numbers, got %lld", a->signature, (long long)expected,
             (long long)size);
    }
    return a->failed;
}

void return_fields(Arguments *a, const void *state, const Field *fields, size_t count)
{
    a->object_result = PyDict_New();
    a->failed = a->object_result == NULL;
    for (size_t i = 0; !a->failed && i < count; ++i) {
        const Py_ssize_t at = (const char *)fields[i].first - (const char *)state;
        PyObject *const place = Py_BuildValue("(nn)", at, fields[i].length);
        a->failed = place == NULL || PyDict_SetItemString(a->object_result, fields[i].name, place) != 0;
        Py_DecRef(place);
    }
}

/* Invert the kinds of the states of this call, by which they are refused; under Python's lock. */
static void mark(const Arguments *a)
{
    for (int i = 0; i < a->parsed; ++i) {
        if (a->owned >> i & 1) {
            StateHead *const head = a->values[i].memory;
            head->kind = ~head->kind;
        }
    }
}

void let_others_run(Arguments *a, int lasts)
{
    if (lasts && !a->failed) {
        mark(a);
        a->waiting = PyEval_SaveThread();
    }
}

PyObject *finish(Arguments *a)
{
    if (a->waiting != NULL) {
        PyEval_RestoreThread(a->waiting);
        mark(a);
    }
    while (a->parsed > 0) {
        if (a->views[--a->parsed].obj != NULL) {
            PyBuffer_Release(&a->views[a->parsed]);
        }
    }
    if (a->failed || PyErr_Occurred() != NULL) {
        Py_DecRef(a->object_result);
        return NULL;
    }
    return a->object_result != NULL ? a->object_result
           : a->is_number           ? PyFloat_FromDouble(a->number_result)
                                    : PyLong_FromLongLong(a->whole_result);
}
