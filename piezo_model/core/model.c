/* The model (2) sample by sample (model.h): the drives x, in normalised units, become outputs y in normalised units,
 * and the states of play and creep, which the caller keeps, go on by as many samples.
 */
#include "model.h"

void model_simulate(const Model *m, const real *x, int64_t count, real *play, real *creep, real *y)
{
    const Shape s = m->shape;
    for (int64_t k = 0; k < count; ++k) {
        /* The creep at this sample follows from the earlier samples alone. */
        const real K = dot(m->w_K, creep, creep_vectors(s)) + m->offset;
        advance(m->operators, s, x[k], play, creep);
        y[k] = superposition(m->low, m->high, m->w_S, s, K + dot(m->w_H, play, play_vectors(s)));
    }
}
