/* The data basis as Python calls it; see data_basis.h. */
#include "data_basis.h"
#include "bindings_model.h"

#define BASIS ((Basis[]){basis_at(MEMORY(0))})

static void set_up(Arguments *a, void *memory, Shape s, double forgetting)
{
    basis_setup(memory, s, forgetting);
    const Basis b = basis_at(memory);
    const Part parts[] = {REGRESSOR_PARTS(&b.regressors, s),
                          {"play", b.play, lanes(s)},
                          {"creep", b.creep, creep_lanes(s)},
                          {"start_play", b.start_play, lanes(s)},
                          {"start_creep", b.start_creep, creep_lanes(s)},
                          {"span", b.span, 4},
                          {"rows", b.rows, BASIS_BLOCK * row_nums(s)},
                          {"gram", b.gram, symmetric_nums(row_width(s))},
                          {"counts", &b.head->filled, 2}};
    RETURN_PARTS(memory, parts);
}

static void update(Basis *b, int64_t samples, const double *x, const double *y)
{
    for (int64_t k = 0; k < samples; ++k) {
        basis_count(b, x[k], y[k]);
    }
}

static void move_on(const Basis *b, int64_t samples, const double *x)
{
    for (int64_t k = 0; k < samples; ++k) {
        advance(b->regressors.operators, b->shape, x[k], b->play, b->creep);
    }
}

static void gram_of(const Basis *b, double *rows, double *gram)
{
    memcpy(rows, b->rows, sizeof(double) * BASIS_BLOCK * (size_t)row_nums(b->shape));
    memcpy(gram, b->gram, sizeof(double) * (size_t)symmetric_nums(row_width(b->shape)));
    if (b->head->filled > 0) {
        basis_add_rows(b->shape, rows, (int)b->head->filled, b->head->forgetting, gram);
    }
}

static void write_rows(const Basis *b, int64_t samples, const double *x, const double *y, double *rows)
{
    for (int64_t k = 0; k < samples; ++k) {
        write_row(&b->regressors, b->shape, 1, x[k], y[k], b->play, b->creep, rows + k * row_nums(b->shape));
    }
}

#define NEED_ROWS NEED_SIZE(r, row_nums(BASIS->shape))
#define BINDINGS(F)                                                                                                    \
    F(basis_bytes, SHAPED, "size of a data basis.", 0, WHOLE_RESULT = basis_bytes(SHAPE_AT(0)))                        \
    F(basis_setup, "state@, " SHAPED ", forgetting", "make a block a data basis; where its vectors stand.",            \
      NEED_BYTES(0, basis_bytes(SHAPE_AT(1))), set_up(&a, MEMORY(0), SHAPE_AT(1), NUMBER(5)))                          \
    F(basis_update, "state@BAS1, x[n], y[n]", "count samples.", SAMPLES_LAST,                                          \
      update(BASIS, LENGTH(n), REALS(1), REALS(2)))                                                                    \
    F(basis_advance, "state@BAS1, x[n]", "move the states on and count nothing.", SAMPLES_LAST,                        \
      move_on(BASIS, LENGTH(n), REALS(1)))                                                                             \
    F(basis_gram, "state@BAS1, rows[b,r]=, gram[g,p]=",                                                                \
      "the Gram matrix with the rows that wait; rows is workspace, and nothing of the basis changes.",                 \
      (NEED_ROWS, NEED_SIZE(b, BASIS_BLOCK), NEED_SIZE(g, row_width(BASIS->shape)),                                    \
       NEED_SIZE(p, padded(row_width(BASIS->shape)))),                                                                 \
      gram_of(BASIS, REALS(1), REALS(2)))                                                                              \
    F(basis_rows, "state@BAS1, x[n], y[n], rows[n,r]=", "the rows of samples; the states move on, nothing counts.",    \
      (NEED_ROWS, SAMPLES_LAST), write_rows(BASIS, LENGTH(n), REALS(1), REALS(2), REALS(3)))
MAKE_BINDINGS(basis)
