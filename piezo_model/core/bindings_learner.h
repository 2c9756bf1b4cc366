/* What the bindings of a single learner and those of a tile share. */
#ifndef CORE_BINDINGS_LEARNER_H
#define CORE_BINDINGS_LEARNER_H

#include "bindings_model.h"
#include "learner.h"

static inline int nums_bounded(const num *v, int count)
{
    return all_bounded((const real *)(const void *)v, (int64_t)count * WIDTH);
}

/* Whether a learner of unknown origin, with blocks of so many samples, is safe: counts and numbers in their ranges. */
static inline int learner_sound(const Learner *l, int block)
{
    const Shape s = l->shape;
    const MailboxHead *const m = l->mailbox.head;
    const Block samples = block_in(&l->mailbox, 0); /* the only one of Python's ring */
    const int checkpoints = MODE(l->settings) == CYCLIC ? 0 : 2 * checkpoint_nums(s);
    return m->block == block && m->blocks == 1 && m->place == 0 && m->delay == block && m->samples >= 0
           && m->filled >= 0 && m->to_go >= 0 && m->filled + m->to_go <= block && m->skipped >= 0 && m->skipped < block
           && m->published == m->consumed && m->offered - m->answered <= 1 && l->clock->next_interval >= 0
           && nums_bounded(l->in_use, 3 * NUMS(l->d)) && nums_bounded(l->gram, data_nums(s))
           && nums_bounded(l->checkpoint.gram, checkpoints)
           && nums_bounded((const num *)(const void *)samples.play, state_nums(s) + block)
           && nums_bounded((const num *)(const void *)l->mailbox.offer.inverse, inverse_nums(s));
}

#endif
