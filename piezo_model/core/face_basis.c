/* The data basis as Python calls it; see data_basis.h. */
#include "data_basis.h"
#include "face_model.h"

TAKE_STATE(basis, Basis, BASIS_KIND)

FACE(basis_bytes) { return size_for(basis_bytes, a); }

FACE(basis_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    const double forgetting = take_number(a);
    need_bytes(a, 0, basis_bytes(s));
    if (!good(a)) {
        return finish(a, NULL);
    }
    basis_setup(memory, s, forgetting);
    Basis b = basis_at(memory);
    const Part parts[] = {{"r", b.regressors.operators.r, lanes(s)},
                          {"a", b.regressors.operators.a, s.rates},
                          {"low", b.regressors.low, zone_lanes(s)},
                          {"high", b.regressors.high, zone_lanes(s)},
                          {"outer_low", b.regressors.outer_low, zone_lanes(s)},
                          {"outer_high", b.regressors.outer_high, zone_lanes(s)},
                          {"play", b.play, lanes(s)},
                          {"creep", b.creep, creep_lanes(s)},
                          {"start_play", b.start_play, lanes(s)},
                          {"start_creep", b.start_creep, creep_lanes(s)},
                          {"span", b.span, 4},
                          {"rows", b.rows, BASIS_BLOCK * row_nums(s)},
                          {"gram", b.gram, symmetric_nums(row_width(s))},
                          {"counts", &b.head->filled, 2}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

FACE(basis_clear)
{
    Basis b = take_basis(a);
    if (good(a)) {
        basis_clear(&b);
    }
    return finish_integer(a, 0);
}

FACE(basis_update)
{
    Basis b = take_basis(a);
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const y = take_array(a, VECTOR, samples);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            basis_count(&b, x[k], y[k]);
        }
    }
    return finish_integer(a, 0);
}

FACE(basis_advance)
{
    Basis b = take_basis(a);
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            advance(b.regressors.operators, b.shape, x[k], b.play, b.creep);
        }
    }
    return finish_integer(a, 0);
}

/* The Gram matrix with the rows that wait; nothing of the basis changes. */
FACE(basis_gram)
{
    Basis b = take_basis(a);
    const Shape s = b.shape;
    double *const rows = take_output(a, BASIS_BLOCK, row_nums(s));
    double *const gram = take_output(a, row_width(s), padded(row_width(s)));
    if (good(a)) {
        memcpy(rows, b.rows, sizeof(double) * BASIS_BLOCK * (size_t)row_nums(s));
        memcpy(gram, b.gram, sizeof(double) * (size_t)symmetric_nums(row_width(s)));
        if (b.head->filled > 0) {
            basis_add_rows(s, rows, (int)b.head->filled, b.head->forgetting, gram);
        }
    }
    return finish_integer(a, 0);
}

/* The rows themselves, which moves the states on and counts nothing. */
FACE(basis_rows)
{
    Basis b = take_basis(a);
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const y = take_array(a, VECTOR, samples);
    double *const rows = take_output(a, samples, row_nums(b.shape));
    if (good(a)) {
        begin_long_if(a, samples > 100);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            write_row(&b.regressors, b.shape, 1, x[k], y[k], b.play, b.creep, rows + k * row_nums(b.shape));
        }
    }
    return finish_integer(a, 0);
}
