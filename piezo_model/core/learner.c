/* A learner as a whole: its memory, its beginning, and what it does with the next block of samples, in continuous
 * (continuous.c) or cyclic operation (cyclic.c). All learners of a tile share clock, settings and mailbox.
 */
#include "direction.h"
#include "rows.h"

static Checkpoint checkpoint_at(Arena *arena, Shape s)
{
    Checkpoint n;
    n.gram = nums(arena, data_nums(s));
    n.in_use = nums(arena, NUMS(unknowns(s)));
    n.level = nums(arena, NUMS(1));
    return n;
}

void N(learner_lay_out)(Learner *l, Arena *own, Arena *checkpoints)
{
    const Shape s = l->shape;
    l->memory = (LearnerMemory *)(void *)nums(own, NUMS((int)(sizeof(LearnerMemory) / sizeof(num))));
    l->in_use = nums(own, NUMS(l->d));
    l->before = nums(own, NUMS(l->d));
    l->candidate = nums(own, NUMS(l->d));
    l->gram = nums(own, data_nums(s));
    l->pieces = l->gram + symmetric_nums(l->d + 1);
    l->noise = l->pieces + NUMS(s.zones);
    l->checkpoint = checkpoint_at(checkpoints, s);
    l->next_checkpoint = checkpoint_at(checkpoints, s);
}

int N(learner_learn)(const Learner *l)
{
    MailboxHead *const m = l->mailbox.head;
    int events = 0;
    if (CORE_ACQUIRE(&m->published) == m->consumed) {
        return 0;
    }
    const Block block = block_at(&l->mailbox, m->consumed);
    const num known = l->memory->fault_count;
    if (block.head->epoch == m->epoch) {
        l->memory->fault_count = from_shared(block.faults, 0);
    }
    if (block.head->epoch == m->epoch && any(l->memory->learning)) {
        const int cyclic = MODE(l->settings) == CYCLIC;
        const int counts = !cyclic || l->clock->phase == BUILD;
        BlockSummary b = counts ? write_rows(l, &block, !cyclic) : count_good(&block);
        b.fault = differs(known, l->memory->fault_count);
        if (block.head->answered == m->offered) {
            l->memory->pending = constant(0);
        }
        events = counts ? judge_direction(l, &block, b.span) : 0;
#ifdef CORE_TILE
        events |= tile_continuous_block(l, &block, &b);
#else
        events |= cyclic ? cyclic_block(l, &b) : continuous_block(l, &block, &b);
#endif
    } else if (WIDTH > 1) { /* where none of a tile learns, each finds later what it would beside one that does */
        N(continuous_pause)(l);
    }
    CORE_RELEASE(&m->consumed, m->consumed + 1);
    return events;
}

void N(learner_begin)(const Learner *l, num which, int resets)
{
    set_where(which, &l->memory->fault_count, from_shared(l->mailbox.faults, 0));
    set_where(which, &l->memory->pending, constant(0));
    copy_where(which, l->before, l->in_use, l->d);
#ifndef CORE_TILE
    if (MODE(l->settings) == CYCLIC) {
        l->clock->past_span = 0; /* the memory of past cycles belongs to the model before */
        forget_direction(l->memory, 1);
        cyclic_enter(l, RESET);
        return;
    }
#endif
    N(continuous_begin)(l, which, resets);
}

#ifndef CORE_TILE
int64_t learner_bytes(Shape s, int block, int blocks, int mode)
{
    return HEAD_BYTES + mailbox_bytes(s, block, blocks) + arena_bytes(sizeof(LearnerSettings))
           + arena_bytes(sizeof(LearnerClock))
           + (int64_t)sizeof(real)
                 * (lanes(s) + rate_lanes(s) + 4 * zone_lanes(s) + learner_nums(s)
                    + (mode == CYCLIC ? 0 : (int64_t)2 * checkpoint_nums(s)))
           + workspace_bytes(s, block, mode) + (mode == CYCLIC ? cyclic_bytes(s) : box_bytes(unknowns(s)));
}

Learner learner_at(void *memory)
{
    const LearnerHead *const head = memory;
    const int mode = (int)MODE(head);
    const Shape s = SHAPE(&head->shaped);
    Arena arena = after_head(memory);
    Learner l = {.shape = s, .d = unknowns(s), .mailbox = mailbox_at(arena.at, s)};
    arena.at += mailbox_bytes(l.shape, head->block, head->blocks);
    l.settings = arena_part(&arena, sizeof *l.settings);
    l.clock = arena_part(&arena, sizeof *l.clock);
    l.regressors = regressors_at(&arena, l.shape);
    Arena none = {NULL};
    learner_lay_out(&l, &arena, mode == CYCLIC ? &none : &arena);
    if (mode == CYCLIC) {
        l.cyclic = cyclic_at(&arena, l.shape);
    }
    l.workspace = arena.at;
    return l;
}

Learner learner_setup(void *memory, Shape shape, int block, int blocks, int mode)
{
    LearnerHead *const head = memory;
    new_shaped_state(memory, LEARNER_KIND, shape, learner_bytes(shape, block, blocks, mode));
    head->block = block;
    head->blocks = blocks;
    head->mode = mode;
    const Learner l = learner_at(memory);
    if (mode == CYCLIC) {
        descent_setup(l.cyclic.descent.head, l.d, l.cyclic.lower, l.cyclic.upper);
    }
    l.mailbox.head->delay = l.mailbox.head->block = block; /* weights take effect a block after their last sample */
    l.mailbox.head->blocks = blocks;
    l.memory->learning = 1;
    return learner_at(memory); /* with the vectors of the recursion */
}
#endif
