#include "model.h"

int64_t model_bytes(Shape s)
{
    return HEAD_BYTES + (int64_t)sizeof(real) * (2 * lanes(s) + rate_lanes(s) + creep_lanes(s) + 3 * zone_lanes(s));
}

Model model_at(void *memory)
{
    const Shape s = SHAPE((const ShapedHead *)memory);
    Model m = {.head = memory, .shape = s};
    const Extent extents[] = {{&m.S.low, zone_lanes(s)},
                              {&m.S.high, zone_lanes(s)},
                              {&m.S.w, zone_lanes(s)},
                              {&m.w_H, lanes(s)},
                              {&m.w_K, creep_lanes(s)}};
    Arena arena = after_head(memory);
    m.operators = take_operators(&arena, s);
    LAY_OUT(&arena, extents);
    return m;
}

Model model_setup(void *memory, Shape shape, real offset)
{
    new_shaped_state(memory, MODEL_KIND, shape, model_bytes(shape));
    ((ModelHead *)memory)->offset = offset;
    return model_at(memory);
}

void model_simulate(const Model *m, const real *x, int64_t count, real *play, real *creep, real *y)
{
    const Shape s = m->shape;
    for (int64_t k = 0; k < count; ++k) {
        /* K belongs to this sample already: the samples before determine it. */
        const real K = dot(m->w_K, creep, creep_vectors(s)) + m->head->offset;
        advance(m->operators, s, x[k], play, creep);
        y[k] = superposition(m->S.low, m->S.high, m->S.w, s, K + dot(m->w_H, play, play_vectors(s)));
    }
}
