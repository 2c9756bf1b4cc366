/* Whether the output rises with the input, as the model does, or falls (a reversed connection), by the correlation r of
 * drive and output:
 *
 *     stretch   samples over which the drive covers at least PART of its range so far, and SHORTEST
 *     r         over deviations from the mean of each stretch, in sums that are multiplied by FADE at each stretch
 *
 * With k samples, r is sure if r^2 k >= SIGNIFICANT. The output rises if r > 0 is sure after FEW stretches, or if r > 0
 * after MANY. It falls if r < 0 and r^2 > FALLS after SOME stretches in a range of WIDE. In between, the last verdict
 * holds. Noise, hysteresis, drift and a lag below a quarter of the period make |r| smaller but do not change its sign
 * for long. Weights are handed over only while the output rises: the inverse of a model of the wrong direction would
 * drive the actuator to a limit and keep it there.
 */
#include "learner.h"

#define PART ((real)0.4)
#define SHORTEST ((real)0.03)
#define FADE ((real)0.96875)
#define SIGNIFICANT ((real)9)
#define FALLS ((real)0.4)
#define FEW ((real)2.5)
#define SOME ((real)12)
#define MANY ((real)20)
#define WIDE ((real)0.06)

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

static BlockSummary count_good(const Block *block)
{
    BlockSummary b = {.count = block->head->count, .end = block->head->first + block->head->count};
    for (int k = 0; k < b.count; ++k) {
        b.good = plus(b.good, is_finite(from_shared(block->y, k)));
    }
    return b;
}

/* Write the rows of a block and summarise it; with `judges`, compute the errors of the weights in use and the
 * candidate. */
static BlockSummary pass_through(const Learner *l, const Block *block, int judges)
{
    const Shape s = l->shape;
    const Workspace work = workspace_of(l), *const w = &work;
    BlockSummary b = count_good(block);
    span_clear(b.span, SPAN, constant(1));
    for (int i = 0; i < state_nums(s); ++i) { /* play, then creep */
        w->play[i] = from_shared(block->play, i);
    }
    for (int k = 0; k < b.count; ++k) {
        num *const row = w->rows + k * row_nums(s);
        const num x = from_shared(block->x, k), y = from_shared(block->y, k), good = is_finite(y);
        write_row(&l->regressors, s, good, x, where(good, y, constant(0)), w->play, w->creep, row);
        span_widen(b.span, (const num[]){x, x, y, y}, good);
    }
    if (judges) {
        N(noise_judge)(l, block, &b);
    }
    return b;
}

void N(learner_forget_direction)(LearnerMemory *m, num which)
{
    copy_where(which, m->evidence, (const num[EVIDENCE]){0}, EVIDENCE);
    span_clear(m->stretch, 2 * SPAN, which);
}

/* The sum of products of deviations from the means. */
static num deviations(const num *e, int a, int b, int ab)
{
    return minus(e[ab], divided(times(e[a], e[b]), greatest(e[ONE], constant(1))));
}

static int judge_direction(const Learner *l, const Block *block, const num *span)
{
    LearnerMemory *const m = l->memory;
    num *const e = m->evidence, *const driven = m->stretch + SPAN;
    for (int k = 0; k < block->head->count; ++k) {
        const num measured = from_shared(block->y, k), good = logical_and(m->learning, is_finite(measured));
        const num x = logical_and(good, from_shared(block->x, k)), y = where(good, measured, constant(0));
        const num terms[] = {good, x, y, times(x, x), times(x, y), times(y, y)};
        for (int i = 0; i < MOMENTS; ++i) {
            e[i] = plus(e[i], terms[i]);
        }
    }
    span_widen(m->stretch, span, m->learning);
    span_widen(driven, m->stretch, constant(1));
    const num range = minus(driven[X_HIGH], driven[X_LOW]);
    const num covered = minus(m->stretch[X_HIGH], m->stretch[X_LOW]);
    const num ends = is_not(less(covered, greatest(constant(SHORTEST), times(constant(PART), range))));
    const num stretch[] = {e[ONE], constant(1), deviations(e, X, X, X_X), deviations(e, X, Y, X_Y),
                           deviations(e, Y, Y, Y_Y)};
    for (int i = COUNT; i < DIRECTION; ++i) {
        set_where(ends, e + i, plus_times(stretch[i - COUNT], constant(FADE), e[i]));
    }
    copy_where(ends, e, (const num[MOMENTS]){0}, MOMENTS);
    span_clear(m->stretch, SPAN, ends);
    const num known = times(e[XX], e[YY]), explained = times(e[XY], e[XY]);
    const num sure = logical_and(less(constant(FEW), e[STRETCHES]),
                                 less(times(constant(SIGNIFICANT), known), times(explained, e[COUNT])));
    const num rises = logical_and(less(constant(0), e[XY]), logical_or(sure, less(constant(MANY), e[STRETCHES])));
    const num falls = logical_and(logical_and(less(e[XY], constant(0)), less(times(constant(FALLS), known), explained)),
                                  logical_and(less(constant(SOME), e[STRETCHES]), less(constant(WIDE), range)));
    const num turns = logical_and(falls, is_not(less(e[DIRECTION], constant(0))));
    e[DIRECTION] = where(rises, constant(1), where(falls, constant(-1), e[DIRECTION]));
    return any(turns) ? REVERSED : 0;
}

void N(learner_add_rows)(const Learner *l, int count, num learns)
{
    const LearnerSettings *const p = l->settings;
    const int stride = row_nums(l->shape);
    num *const rows = workspace_of(l).rows + 1;
    const num forgetting = constant(p->forgetting), root_step = constant(ROOT(p->forgetting));
    const Block block = block_at(&l->mailbox, l->mailbox.head->consumed);
    num root = times(learns, constant(ROOT(p->row_weight))), fade = constant(1);
    /* The newest row has the full weight. */
    for (int k = count - 1; k >= 0 && (p->forgetting < 1 || p->row_weight < 1); --k) {
        num *const row = rows + k * stride;
        const num counts = logical_and(learns, is_finite(from_shared(block.y, k)));
        const vec8 weight = SPREAD(root);
        for (int i = 0; i < VECTORS(l->d + 1); ++i) {
            set_vector(row, i, mul(weight, vector(row, i)));
        }
        root = where(counts, times(root, root_step), root);
        fade = where(counts, times(fade, forgetting), fade);
    }
    gram_add(l->gram, l->d + 1, fade, rows, stride, count);
}

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
        BlockSummary b = counts ? pass_through(l, &block, !cyclic) : count_good(&block);
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
        learner_forget_direction(l->memory, 1);
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
    Learner l = learner_at(memory);
    if (mode == CYCLIC) {
        descent_setup(l.cyclic.descent.head, l.d, l.cyclic.lower, l.cyclic.upper);
        l = learner_at(memory);
    }
    l.mailbox.head->delay = l.mailbox.head->block = block; /* weights take effect a block after their last sample */
    l.mailbox.head->blocks = blocks;
    l.memory->learning = 1;
    return l;
}
#endif
