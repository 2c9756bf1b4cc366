/* The data basis as Python calls it; see data_basis.h. */
#include "data_basis.h"
#include "face_model.h"

static Shape take_basis(Arguments *a, Basis *b)
{
    void *const memory = take_state(a, BASIS_KIND);
    if (memory != NULL) {
        *b = basis_at(memory);
    } else {
        memset(b, 0, sizeof *b);
    }
    return b->shape;
}

FACE(face_basis_bytes)
{
    (void)module;
    return size_for(basis_bytes, "basis_bytes(n, zones, rates, offset)", given, count);
}

FACE(face_basis_setup)
{
    Arguments a;
    Basis b;
    Shape s;
    void *memory;
    double forgetting;
    (void)module;
    take_arguments(&a, "basis_setup(state, n, zones, rates, offset, forgetting)", given, count, 6);
    memory = take_state(&a, 0);
    s = take_shape(&a);
    forgetting = take_number(&a);
    need_bytes(&a, 0, basis_bytes(s));
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    basis_setup(memory, s, forgetting);
    b = basis_at(memory);
    const Part parts[] = {
        {"r", b.regressors.operators.r, lanes(s)}, {"a", b.regressors.operators.a, creep_lanes(s)},
        {"low", b.regressors.low, zone_lanes(s)}, {"high", b.regressors.high, zone_lanes(s)},
        {"outer_low", b.regressors.outer_low, zone_lanes(s)}, {"outer_high", b.regressors.outer_high, zone_lanes(s)},
        {"play", b.play, lanes(s)}, {"creep", b.creep, creep_lanes(s)}, {"start_play", b.start_play, lanes(s)},
        {"start_creep", b.start_creep, creep_lanes(s)}, {"span", b.span, 4}, {"rows", b.rows, BASIS_BLOCK * row_stride(s)},
        {"gram", b.gram, padded(row_width(s)) * row_stride(s)}, {"counts", &b.head->filled, 2}};
    return finish_parts(&a, memory, parts, (int)(sizeof parts / sizeof *parts));
}

FACE(face_basis_clear)
{
    Arguments a;
    Basis b;
    (void)module;
    take_arguments(&a, "basis_clear(state)", given, count, 1);
    take_basis(&a, &b);
    if (good(&a)) {
        basis_clear(&b);
    }
    return finish_integer(&a, 0);
}

FACE(face_basis_update)
{
    Arguments a;
    Basis b;
    const double *x, *y;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "basis_update(state, x, y)", given, count, 3);
    take_basis(&a, &b);
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    y = take_array(&a, VECTOR, (int)samples);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            basis_count(&b, x[k], y[k]);
        }
    }
    return finish_integer(&a, 0);
}

FACE(face_basis_advance)
{
    Arguments a;
    Basis b;
    const double *x;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "basis_advance(state, x)", given, count, 2);
    take_basis(&a, &b);
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            advance(b.regressors.operators, b.shape, x[k], b.play, b.creep);
        }
    }
    return finish_integer(&a, 0);
}

/* The Gram matrix with the rows that wait; nothing of the basis changes. */
FACE(face_basis_gram)
{
    Arguments a;
    Basis b;
    Shape s;
    double *rows, *gram;
    (void)module;
    take_arguments(&a, "basis_gram(state, rows, gram)", given, count, 3);
    s = take_basis(&a, &b);
    rows = take_output(&a, BASIS_BLOCK, row_stride(s));
    gram = take_output(&a, padded(row_width(s)), row_stride(s));
    if (good(&a)) {
        memcpy(rows, b.rows, sizeof(double) * BASIS_BLOCK * (size_t)row_stride(s));
        memcpy(gram, b.gram, sizeof(double) * (size_t)padded(row_width(s)) * (size_t)row_stride(s));
        if (b.head->filled > 0) {
            basis_add_rows(s, rows, (int)b.head->filled, b.head->forgetting, gram);
        }
    }
    return finish_integer(&a, 0);
}

/* The rows themselves, which moves the states on and counts nothing. */
FACE(face_basis_rows)
{
    Arguments a;
    Basis b;
    Shape s;
    const double *x, *y;
    double *rows;
    Py_ssize_t samples;
    (void)module;
    take_arguments(&a, "basis_rows(state, x, y, rows)", given, count, 4);
    s = take_basis(&a, &b);
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    y = take_array(&a, VECTOR, (int)samples);
    rows = take_output(&a, (int)samples, row_stride(s));
    if (good(&a)) {
        begin_long_if(&a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            regressor_row(&b.regressors, s, x[k], y[k], b.play, b.creep, rows + k * row_stride(s));
        }
    }
    return finish_integer(&a, 0);
}
