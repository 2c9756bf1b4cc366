#include "model.h"

void model_simulate(const Model *m, const real *x, int64_t count, real *play, real *creep, real *y)
{
    const Shape s = m->shape;
    for (int64_t k = 0; k < count; ++k) {
        /* K belongs to this sample already: the samples before determine it. */
        const real K = dot(m->w_K, creep, creep_vectors(s)) + m->offset;
        advance(m->operators, s, x[k], play, creep);
        y[k] = superposition(m->S.low, m->S.high, m->S.w, s, K + dot(m->w_H, play, play_vectors(s)));
    }
}
