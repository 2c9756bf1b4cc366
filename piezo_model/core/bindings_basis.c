/* The data basis as Python calls it; see data_basis.h. */
#include "data_basis.h"
#include "bindings_model.h"

#define BASIS ((Basis[]){basis_at(MEMORY(0))})

static void set_up(Arguments *a, void *memory, Shape s, double forgetting)
{
    basis_setup(memory, s, forgetting);
    const Basis b = basis_at(memory);
    const Field fields[] = {REGRESSOR_PARTS(&b.regressors, s),
                            {"play", b.play, lanes(s)},
                            {"creep", b.creep, creep_lanes(s)},
                            {"gram", b.gram, symmetric_nums(row_width(s))},
                            {"counts", &b.head->filled, 2}};
    RETURN_FIELDS(memory, fields);
}

static void update(Basis *b, int64_t samples, const double *x, const double *y)
{
    for (int64_t k = 0; k < samples; ++k) {
        if (y[k] == y[k]) {
            basis_count(b, x[k], y[k]);
        } else { /* no output: the sample moves the operators alone */
            advance(b->regressors.operators, b->shape, x[k], b->play, b->creep);
        }
    }
}

static void write_rows(const Basis *b, int64_t samples, const double *x, const double *y, double *rows)
{
    for (int64_t k = 0; k < samples; ++k) {
        write_row(&b->regressors, b->shape, 1, x[k], y[k], b->play, b->creep, rows + k * row_nums(b->shape));
    }
}

#define BINDINGS(F)                                                                                                    \
    F(basis_bytes, SHAPED, "size of a data basis.", 0, WHOLE_RESULT = basis_bytes(SHAPE_AT(0)))                        \
    F(basis_setup, "state@, " SHAPED ", forgetting", "initialise a data basis; returns its parts.",                    \
      NEED_BYTES(0, basis_bytes(SHAPE_AT(1))), set_up(&a, MEMORY(0), SHAPE_AT(1), NUMBER(5)))                          \
    F(basis_update, "state@BAS1, x[n], y[n]", "add samples.", SAMPLES_LAST,                                            \
      update(BASIS, LENGTH(n), REALS(1), REALS(2)))                                                                    \
    F(basis_finish, "state@BAS1", "add the rows of the unfinished block to the Gram matrix.", 0, basis_finish(BASIS))  \
    F(basis_rows, "state@BAS1, x[n], y[n], rows[n,r]=", "the rows of samples; advances the states, adds nothing.",     \
      (NEED_SIZE(r, row_nums(BASIS->shape)), SAMPLES_LAST),                                                            \
      write_rows(BASIS, LENGTH(n), REALS(1), REALS(2), REALS(3)))
MAKE_BINDINGS(basis)
