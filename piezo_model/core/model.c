#include "model.h"

int64_t model_bytes(Shape s)
{
    return HEAD_BYTES + (int64_t)sizeof(real) * (2 * lanes(s) + rate_lanes(s) + creep_lanes(s) + 3 * zone_lanes(s));
}

Model model_at(void *memory)
{
    Model m;
    Arena arena = after_head(memory);
    m.head = memory;
    m.shape = SHAPE(&m.head->shaped);
    m.operators = take_operators(&arena, m.shape);
    m.S = take_superposition(&arena, m.shape);
    m.w_H = reals(&arena, 1, lanes(m.shape));
    m.w_K = reals(&arena, 1, creep_lanes(m.shape));
    return m;
}

Model model_setup(void *memory, Shape shape, real offset)
{
    const ModelHead head = {{MODEL_KIND, unknowns(shape), model_bytes(shape), shape}, offset};
    memset(memory, 0, (size_t)model_bytes(shape));
    memcpy(memory, &head, sizeof head);
    return model_at(memory);
}

real model_step(const Model *m, real x, real *play, real *creep)
{
    /* K belongs to this sample already: the samples before determine it. */
    const real K = dot(m->w_K, creep, creep_vectors(m->shape)) + m->head->offset;
    advance(m->operators, m->shape, x, play, creep);
    return superposition(m->S.low, m->S.high, m->S.w, m->shape, K + dot(m->w_H, play, play_vectors(m->shape)));
}

void model_simulate(const Model *m, const real *x, int64_t count, real *play, real *creep, real *y)
{
    for (int64_t k = 0; k < count; ++k) {
        y[k] = model_step(m, x[k], play, creep);
    }
}
