/* The offer of new weights to the drive, with their inverse and the noise of the sensor, through the mailbox; the drive
 * answers it when it is due. The unknowns are slopes of S^-1, the drive needs its weights.
 */
#include "learner.h"

/* All weights of the unknowns v, with their inverse. */
static Inverse invert_unknowns(const Learner *l, const num *v)
{
    const Shape s = l->shape;
    const Inverse inverse = workspace_of(l).inverse, *const p = &inverse;
    const num *const slopes = v + s.n;
    const int middle = (int)l->settings->middle;
    p->w_H[0] = constant(1);
    for (int i = 0; i < s.n; ++i) {
        p->w_H[i + 1] = v[i];
    }
    for (int i = 0; i < s.zones; ++i) {
        const num inner = i > middle ? slopes[i - 1] : i < middle ? slopes[i + 1] : constant(0);
        p->w_S[i] = minus(slopes[i], inner);
    }
    for (int i = 0; i < creep_weights(s); ++i) {
        p->w_K[i] = slopes[s.zones + i];
    }
    p->offset[0] = s.offset ? v[l->d - 1] : constant(0);
    invert(p, s, l->regressors.operators.r, l->regressors.low, l->regressors.high);
    return inverse;
}

int N(learner_offer)(const Learner *l, const num *v, num which, num fallback, int64_t due)
{
    MailboxHead *const m = l->mailbox.head;
    const Offer *const o = &l->mailbox.offer;
    if (m->offered != CORE_ACQUIRE(&m->answered)) {
        return 0;
    }
    num noise = N(noise_variance)(l);
    const Inverse inverse = invert_unknowns(l, v);
    for (int i = 0; i < inverse_nums(l->shape); ++i) {
        to_shared(o->inverse, i, inverse.w_H[i]);
    }
    to_shared(o->which, 0, which);
    to_shared(o->fallback, 0, fallback);
    for (int lane = 0; lane < WIDTH; ++lane) {
        *entry(&noise, 0, lane) = ROOT(*entry(&noise, 0, lane));
    }
    to_shared(o->noise, 0, noise);
    to_shared(o->faults, 0, l->memory->fault_count);
    *o->due = due;
    *o->epoch = m->epoch;
    CORE_RELEASE(&m->offered, m->offered + 1);
    return 1;
}
