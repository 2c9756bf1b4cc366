#include "data_basis.h"

int64_t basis_bytes(Shape s)
{
    const int vectors = 3 * lanes(s) + rate_lanes(s) + 2 * creep_lanes(s) + 4 * zone_lanes(s) + LANES;
    return HEAD_BYTES + (int64_t)sizeof(real) * (vectors + BASIS_BLOCK * row_nums(s) + symmetric_nums(row_width(s)));
}

Basis basis_at(void *memory)
{
    const Shape s = SHAPE((const ShapedHead *)memory);
    Basis b = {.head = memory, .shape = s};
    Arena arena = after_head(memory);
    b.regressors = regressors_at(&arena, s);
    const Extent extents[] = {{&b.play, lanes(s)},
                              {&b.creep, creep_lanes(s)},
                              {&b.start_play, lanes(s)},
                              {&b.start_creep, creep_lanes(s)},
                              {&b.span, LANES},
                              {&b.rows, BASIS_BLOCK * row_nums(s)},
                              {&b.gram, symmetric_nums(row_width(s))}};
    LAY_OUT(&arena, extents);
    return b;
}

void basis_setup(void *memory, Shape shape, real forgetting)
{
    new_shaped_state(memory, BASIS_KIND, shape, basis_bytes(shape));
    Basis b = basis_at(memory);
    b.head->forgetting = forgetting;
    b.span[X_MIN] = b.span[Y_MIN] = REAL_INFINITY;
    b.span[X_MAX] = b.span[Y_MAX] = -REAL_INFINITY;
}

void basis_add_rows(Shape s, real *rows, int count, real forgetting, real *gram)
{
    const int stride = row_nums(s);
    real weight = 1;
    for (int k = count - 1; k >= 0 && forgetting != 1; --k) { /* each row times the root of its weight */
        const vec8 root = splat(ROOT(weight));
        for (int i = 0; i < stride; i += LANES) {
            store(rows + k * stride + i, mul(load(rows + k * stride + i), root));
        }
        weight *= forgetting;
    }
    gram_add(gram, row_width(s), weight, rows, stride, count);
}

/* What the excitation of the operators is judged by later. */
static void note_start(Basis *b, real x)
{
    for (int i = 0; i < lanes(b->shape); i += LANES) {
        store(b->start_play + i, play8(splat(x), load(b->regressors.operators.r + i), load(b->play + i)));
    }
    for (int i = 0; i < creep_lanes(b->shape); i += LANES) {
        store(b->start_creep + i, load(b->creep + i));
    }
}

void basis_count(Basis *b, real x, real y)
{
    BasisHead *const head = b->head;
    if (head->samples == 0) {
        note_start(b, x);
    }
    write_row(&b->regressors, b->shape, 1, x, y, b->play, b->creep, b->rows + head->filled * row_nums(b->shape));
    ++head->samples;
    ++head->filled;
    if (head->filled == BASIS_BLOCK) {
        basis_add_rows(b->shape, b->rows, BASIS_BLOCK, head->forgetting, b->gram);
        head->filled = 0;
    }
    b->span[X_MIN] = least(b->span[X_MIN], x);
    b->span[X_MAX] = most(b->span[X_MAX], x);
    b->span[Y_MIN] = least(b->span[Y_MIN], y);
    b->span[Y_MAX] = most(b->span[Y_MAX], y);
}
