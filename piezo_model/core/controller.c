/* The step of a self-learning compensator (controller.h), in the order of a sample: `controller_observe` takes the
 * output of the drive before, `controller_drive` gives the next drive, and between them only a full block of samples
 * reaches the learner. References and outputs are in the units of the structure; what goes into a block, and the states
 * of the operators, are normalised. Both take the same time at every sample, but for the first drive of a block.
 */
#include "controller.h"

static SensorGuard *guard_of(const Controller *c) { return (SensorGuard *)(void *)c->mailbox.guard; }

void N(controller_begin_block)(const Controller *c, const num *play, const num *creep)
{
    MailboxHead *const m = c->mailbox.head;
    const int32_t place = (int32_t)(m->published % (uint32_t)m->blocks);
    const Block b = block_in(&c->mailbox, place);
    const int k = play_vectors(c->compensator.shape), states = k + creep_vectors(c->compensator.shape);
    for (int i = 0; i < states; ++i) {
        store((real *)(void *)b.play + LANES * i, i < k ? vector(play, i) : vector(creep, i - k));
    }
    b.head->first = m->samples;
    b.head->epoch = m->epoch;
    b.head->answered = m->answered;
    m->place = place;
    m->filled = 0;
    m->to_go = m->block - m->skipped;
}

void N(controller_begin)(const Controller *c, const num *play, const num *creep)
{
    MailboxHead *const m = c->mailbox.head;
    ++m->epoch;
    m->consumed = m->published;
    m->answered = m->offered;
    m->skipped = (int32_t)(m->samples % m->block);
    guard_forget(guard_of(c), constant(1));
    if (c->compensator.shape.ring > 0) {
        const Prefilter *const p = &c->compensator.prefilter;
        memmove(p->play, play, sizeof(num) * (size_t)(play_vectors(c->compensator.shape) * (LANES / WIDTH)));
        memmove(p->creep, creep, sizeof(num) * (size_t)(creep_vectors(c->compensator.shape) * (LANES / WIDTH)));
    }
    N(controller_begin_block)(c, play, creep);
}

int N(controller_observe)(const Controller *c, num x, num y)
{
    const DriveSettings *const p = c->compensator.settings;
    MailboxHead *const m = c->mailbox.head;
    const Block b = block_in(&c->mailbox, m->place);
    num unit_y = divided(minus(y, constant(p->y_centre)), constant(p->y_scale)), fault;
    num good = guard_judge(guard_of(c), x, unit_y, &fault);
    const num counted = plus(from_shared(c->mailbox.faults, 0), fault);
    const num faults = where(less(constant(MOST_COUNTED), counted), constant(0), counted);
    N(compensator_correct)(&c->compensator, y, good);
    if (c->compensator.shape.ring > 0) {
        y = N(sensor_filter)(&c->compensator.prefilter, c->compensator.shape, y, &good);
        x = N(sensor_drive)(&c->compensator.prefilter, c->compensator.shape, c->compensator.operators, x);
        unit_y = divided(minus(y, constant(p->y_centre)), constant(p->y_scale));
    }
    to_shared(b.x, m->filled, x);
    to_shared(b.y, m->filled, where(good, unit_y, constant((real)NAN)));
    to_shared(c->mailbox.faults, 0, faults);
    ++m->samples;
    ++m->filled;
    if (--m->to_go > 0) {
        return 0;
    }
    b.head->count = m->filled;
    to_shared(b.faults, 0, faults);
    m->filled = m->skipped = 0;
    if (m->blocks == 1 || m->published + 1 - CORE_ACQUIRE(&m->consumed) < (uint32_t)m->blocks) {
        CORE_RELEASE(&m->published, m->published + 1);
    } else {
        CORE_RELEASE(&m->dropped, m->dropped + 1);
    }
    return 1;
}

/* Read an offer that is due; 1 if it belongs to this epoch. `answered` counts it. An offer from before a sensor fault
 * is not taken, unless it is the fallback after a fault. */
static int find_offer(const Controller *c, Change *change, uint32_t *answered)
{
    MailboxHead *const m = c->mailbox.head;
    const Offer *const o = &c->mailbox.offer;
    const uint32_t offered = CORE_ACQUIRE(&m->offered);
    Arena arena = {(char *)o->inverse};
    *answered = m->answered;
    if (offered == m->answered || (*o->epoch == m->epoch && m->samples < *o->due)) {
        return 0;
    }
    const int current = *o->epoch == m->epoch;
    if (current) {
        const num unknown = differs(from_shared(o->faults, 0), from_shared(c->mailbox.faults, 0));
        change->inverse = inverse_at(&arena, c->compensator.shape);
        change->which = logical_and(from_shared(o->which, 0), logical_or(from_shared(o->fallback, 0), is_not(unknown)));
        set_where(change->which, &guard_of(c)->jump,
                  greatest(times(constant(NOISY), from_shared(o->noise, 0)), constant(JUMP)));
        CORE_RELEASE(&m->late, m->late + (m->samples > *o->due));
    }
    *answered = offered;
    return current;
}

num N(controller_drive)(const Controller *c, num y_ref)
{
    MailboxHead *const m = c->mailbox.head;
    Change change;
    uint32_t answered;
    if (m->filled > 0) {
        return N(compensator_step)(&c->compensator, y_ref, NULL);
    }
    const int changes = find_offer(c, &change, &answered);
    const Prefilter *const p = &c->compensator.prefilter;
    const int late = c->compensator.shape.ring > 0;
    N(controller_begin_block)(c, late ? p->play : c->compensator.play, late ? p->creep : c->compensator.creep);
    block_at(&c->mailbox, m->published).head->answered = answered;
    const num x = N(compensator_step)(&c->compensator, y_ref, changes ? &change : NULL);
    CORE_RELEASE(&m->answered, answered); /* now the learner may overwrite the offer */
    return x;
}
