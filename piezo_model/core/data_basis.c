#include "data_basis.h"

enum { TILE = 4 }; /* rows of the Gram matrix that are summed at a time, eight columns each */

int64_t basis_bytes(Shape s)
{
    const int vectors = 3 * lanes(s) + 3 * creep_lanes(s) + 4 * zone_lanes(s) + LANES;
    return HEAD_BYTES + (int64_t)sizeof(real) * (vectors + (BASIS_BLOCK + padded(row_width(s))) * row_stride(s));
}

Basis basis_at(void *memory)
{
    Basis b;
    Room room = after_head(memory);
    b.head = memory;
    b.shape = SHAPE(&b.head->shaped);
    b.regressors = take_regressors(&room, b.shape);
    b.play = reals(&room, 1, lanes(b.shape));
    b.creep = reals(&room, 1, creep_lanes(b.shape));
    b.start_play = reals(&room, 1, lanes(b.shape));
    b.start_creep = reals(&room, 1, creep_lanes(b.shape));
    b.span = reals(&room, 1, LANES);
    b.rows = reals(&room, BASIS_BLOCK, row_stride(b.shape));
    b.gram = reals(&room, padded(row_width(b.shape)), row_stride(b.shape));
    return b;
}

void basis_setup(void *memory, Shape shape, real forgetting)
{
    const BasisHead head = {{BASIS_KIND, unknowns(shape), basis_bytes(shape), shape}, forgetting, 0, 0};
    Basis b;
    memset(memory, 0, (size_t)head.shaped.bytes);
    memcpy(memory, &head, sizeof head);
    b = basis_at(memory);
    basis_clear(&b);
}

void basis_clear(Basis *b)
{
    b->head->filled = b->head->samples = 0;
    b->span[X_MIN] = b->span[Y_MIN] = REAL_INFINITY;
    b->span[X_MAX] = b->span[Y_MAX] = -REAL_INFINITY;
    memset(b->gram, 0, sizeof(real) * (size_t)padded(row_width(b->shape)) * (size_t)row_stride(b->shape));
}

/* Each row times the root of its weight, and the Gram matrix times that of all of them. */
static void forget(Shape s, real *rows, int count, real forgetting, real *gram)
{
    real weight = 1;
    for (int k = count - 1; k >= 0; --k) {
        const vec8 root = splat(ROOT(weight));
        for (int i = 0; i < row_stride(s); i += LANES) {
            real *const at = rows + k * row_stride(s) + i;
            store(at, mul(load(at), root));
        }
        weight *= forgetting;
    }
    for (int i = 0; i < padded(row_width(s)) * row_stride(s); i += LANES) {
        store(gram + i, mul(load(gram + i), splat(weight)));
    }
}

void basis_add_rows(Shape s, real *rows, int count, real forgetting, real *gram)
{
    const int stride = row_stride(s);
    if (forgetting != 1) {
        forget(s, rows, count, forgetting, gram);
    }
    for (int i = 0; i < row_width(s); i += TILE) {
        for (int j = i; j < row_width(s); j += LANES) {
            real *const to = gram + i * stride + j;
            vec8 sum0 = zeros(), sum1 = sum0, sum2 = sum0, sum3 = sum0;
            for (int k = 0; k < count; ++k) {
                const real *const left = rows + k * stride + i;
                const vec8 right = load(rows + k * stride + j);
                sum0 = plus_product(sum0, splat(left[0]), right);
                sum1 = plus_product(sum1, splat(left[1]), right);
                sum2 = plus_product(sum2, splat(left[2]), right);
                sum3 = plus_product(sum3, splat(left[3]), right);
            }
            store(to, add(load(to), sum0));
            store(to + stride, add(load(to + stride), sum1));
            store(to + 2 * stride, add(load(to + 2 * stride), sum2));
            store(to + 3 * stride, add(load(to + 3 * stride), sum3));
        }
    }
}

void basis_gather(Basis *b)
{
    if (b->head->filled > 0) {
        basis_add_rows(b->shape, b->rows, (int)b->head->filled, b->head->forgetting, b->gram);
        b->head->filled = 0;
    }
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
    regressor_row(&b->regressors, b->shape, x, y, b->play, b->creep, b->rows + head->filled * row_stride(b->shape));
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
