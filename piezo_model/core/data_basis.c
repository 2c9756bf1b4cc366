/* The memory of a data basis, and what one sample adds to it (data_basis.h): the states of the operators go on, a row
 * of the error model is written to the block, and a full block is added to the Gram matrix. Drives and outputs come in
 * normalised units, and so are the rows and their products.
 */
#include "data_basis.h"

int64_t basis_bytes(Shape s)
{
    const int vectors = 2 * lanes(s) + rate_lanes(s) + creep_lanes(s) + 4 * zone_lanes(s);
    return HEAD_BYTES + (int64_t)sizeof(real) * (vectors + BASIS_BLOCK * row_nums(s) + symmetric_nums(row_width(s)));
}

Basis basis_at(void *memory)
{
    const Shape s = SHAPE((const ShapedHead *)memory);
    Basis b = {.head = memory, .shape = s};
    Arena arena = after_head(memory);
    b.regressors = regressors_at(&arena, s);
    const ArenaField fields[] = {{&b.play, lanes(s)},
                                 {&b.creep, creep_lanes(s)},
                                 {&b.rows, BASIS_BLOCK * row_nums(s)},
                                 {&b.gram, symmetric_nums(row_width(s))}};
    LAY_OUT(&arena, fields);
    return b;
}

void basis_setup(void *memory, Shape shape, real forgetting)
{
    new_shaped_state(memory, BASIS_KIND, shape, basis_bytes(shape));
    ((BasisHead *)memory)->forgetting = forgetting;
}

void basis_finish(Basis *b)
{
    BasisHead *const head = b->head;
    const int stride = row_nums(b->shape), count = (int)head->filled;
    real weight = 1;
    for (int k = count - 1; k >= 0 && head->forgetting != 1; --k) { /* scale each row by the root of its weight */
        const vec8 root = splat(ROOT(weight));
        for (int i = 0; i < stride; i += LANES) {
            store(b->rows + k * stride + i, mul(load(b->rows + k * stride + i), root));
        }
        weight *= head->forgetting;
    }
    gram_add(b->gram, row_width(b->shape), weight, b->rows, stride, count);
    head->filled = 0;
}

void basis_count(Basis *b, real x, real y)
{
    BasisHead *const head = b->head;
    write_row(&b->regressors, b->shape, 1, x, y, b->play, b->creep, b->rows + head->filled * row_nums(b->shape));
    ++head->samples;
    ++head->filled;
    if (head->filled == BASIS_BLOCK) {
        basis_finish(b);
    }
}
