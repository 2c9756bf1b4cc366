/* The memory and the step of a bank (bank.h): tables of the tiles' drivers, learners and checkpoints, one part of each
 * tile after the other, so that a step reads what it needs and the next tile's part is fetched meanwhile.
 * `tile_step` is the whole of a sample: observe, learn from a full block, drive. References, outputs and drives are in
 * the units of the structure, states and weights normalised, each number for eight actuators.
 */
#define CORE_TILE
#include "bank.h"

enum { TOGETHER = 32 }; /* tiles that process many samples together; fits into the second-level cache */

static int64_t bytes_of(int64_t count) { return arena_bytes((int64_t)sizeof(num) * count); }
static int memory_nums(void) { return (int)(sizeof(DriveMemory) / sizeof(num)); }
static int64_t compensator_part_bytes(Shape s)
{
    return bytes_of(memory_nums() + state_nums(s) + inverse_nums(s) + prefilter_nums(s));
}
static int64_t driver_bytes(Shape s, int block) { return compensator_part_bytes(s) + mailbox_bytes(s, block, 1); }
static int64_t learner_part_bytes(Shape s) { return arena_bytes(sizeof(LearnerClock)) + bytes_of(learner_nums(s)); }
static int64_t checkpoint_bytes(Shape s) { return bytes_of(2 * checkpoint_nums(s)); }
static int64_t parameter_bytes(Shape s)
{
    return arena_bytes(sizeof(DriveSettings)) + arena_bytes(sizeof(LearnerSettings))
           + (int64_t)sizeof(real) * (lanes(s) + rate_lanes(s) + 4 * zone_lanes(s));
}

int64_t bank_bytes(Shape s, int64_t tiles, int block)
{
    return HEAD_BYTES + parameter_bytes(s)
           + tiles * (driver_bytes(s, block) + learner_part_bytes(s) + checkpoint_bytes(s));
}

int64_t bank_workspace_bytes(Shape s, int block)
{
    return workspace_bytes(s, block, CONTINUOUS) + box_bytes(unknowns(s));
}

Bank bank_at(void *memory)
{
    Bank b = {.head = memory, .shape = SHAPE((const ShapedHead *)memory)};
    Arena arena = after_head(memory);
    b.drive_settings = arena_part(&arena, sizeof *b.drive_settings);
    b.learner_settings = arena_part(&arena, sizeof *b.learner_settings);
    b.regressors = regressors_at(&arena, b.shape);
    b.drivers = (char *)memory + HEAD_BYTES + parameter_bytes(b.shape);
    b.learners = b.drivers + b.head->tiles * driver_bytes(b.shape, b.head->block);
    b.checkpoints = b.learners + b.head->tiles * learner_part_bytes(b.shape);
    return b;
}

Controller tile_controller(const Bank *b, int64_t tile)
{
    const Shape s = b->shape;
    const Regressors *const r = &b->regressors;
    Controller c = {
        .compensator = {
            .shape = s, .settings = b->drive_settings, .operators = r->operators, .low = r->low, .high = r->high}};
    Arena arena = {b->drivers + tile * driver_bytes(s, b->head->block)};
    c.compensator.memory = (DriveMemory *)(void *)nums(&arena, memory_nums());
    c.compensator.play = nums(&arena, play_vectors(s));
    c.compensator.creep = nums(&arena, creep_vectors(s));
    c.compensator.inverse = inverse_at(&arena, s);
    c.compensator.prefilter = prefilter_at(&arena, s);
    c.mailbox = mailbox_at((char *)c.compensator.memory + compensator_part_bytes(s), s);
    return c;
}

Learner tile_learner(const Bank *b, int64_t tile, void *thread_workspace)
{
    const Shape s = b->shape;
    Arena arena = {b->learners + tile * learner_part_bytes(s)},
          checkpoints = {b->checkpoints + tile * checkpoint_bytes(s)};
    Learner l = {.shape = s,
                 .d = unknowns(s),
                 .settings = b->learner_settings,
                 .regressors = b->regressors,
                 .mailbox = tile_controller(b, tile).mailbox,
                 .workspace = thread_workspace};
    l.clock = arena_part(&arena, sizeof *l.clock);
    tile_learner_lay_out(&l, &arena, &checkpoints);
    return l;
}

Bank bank_setup(void *memory, Shape s, int64_t tiles, int block)
{
    BankHead *const head = memory;
    new_shaped_state(memory, BANK_KIND, s, bank_bytes(s, tiles, block));
    head->tiles = tiles;
    head->block = block;
    return bank_at(memory);
}

void tile_prepare(const Bank *b, int64_t tile, int64_t late)
{
    MailboxHead *const m = tile_controller(b, tile).mailbox.head;
    m->block = b->head->block;
    m->blocks = 1;
    m->delay = b->head->block;
    m->samples = late;
    m->skipped = (int32_t)(late % m->block);
}

void tile_begin(const Bank *b, int64_t tile, num which)
{
    const Controller controller = tile_controller(b, tile);
    const Compensator *const c = &controller.compensator;
    const Learner learner = tile_learner(b, tile, NULL), *const l = &learner;
    const Block block = block_at(&l->mailbox, l->mailbox.head->published);
    guard_forget((SensorGuard *)(void *)l->mailbox.guard, which);
    invert(&c->inverse, b->shape, b->regressors.operators.r, b->regressors.low, b->regressors.high);
    tile_compensator_balance(c, which);
    copy_where(which, (num *)block.play, c->play, state_nums(b->shape)); /* play, then creep */
    for (int k = 0; k < b->head->block; ++k) {
        set_where(which, (num *)block.y + k, constant((real)NAN));
    }
    set_where(which, (num *)l->mailbox.offer.which, constant(0)); /* of the model before */
    tile_learner_begin(l, which, 1);
}

static num tile_step(const Bank *b, int64_t tile, num y_ref, num y, void *workspace)
{
    const Controller c = tile_controller(b, tile);
    if (c.mailbox.head->to_go > 0 && tile_controller_observe(&c, c.compensator.play[0], y)) { /* a drive precedes */
        const Learner l = tile_learner(b, tile, workspace);
        tile_learner_learn(&l);
    }
    return tile_controller_drive(&c, y_ref);
}

/* Prefetch the memory of a tile's next step, without the prefilter, of which a step needs a part only. */
CORE_INLINE void fetch_tile(const Bank *b, int64_t tile)
{
    const char *const driver = b->drivers + tile * driver_bytes(b->shape, b->head->block);
    const MailboxHead *const m = (const MailboxHead *)(const void *)(driver + compensator_part_bytes(b->shape));
    fetch(driver, compensator_part_bytes(b->shape) - bytes_of(prefilter_nums(b->shape)));
    fetch((const char *)m, arena_bytes(sizeof *m) + shared_bytes(GUARD_NUMS));
    if (m->to_go == 1) {
        fetch(b->learners + tile * learner_part_bytes(b->shape), learner_part_bytes(b->shape));
    }
}

void bank_step(const Bank *b, int64_t first, int64_t last, const real *y_ref, const real *y, real *x, int64_t samples,
               void *workspace)
{
    const int64_t width = b->head->tiles * LANES;
    for (int64_t begin = first; begin < last; begin += TOGETHER) {
        const int64_t end = begin + TOGETHER < last ? begin + TOGETHER : last;
        for (int64_t k = 0; k < samples; ++k) {
            for (int64_t i = begin; i < end; ++i) {
                const int64_t at = k * width + i * LANES;
                if (i + 1 < last) {
                    fetch_tile(b, i + 1);
                }
                store(x + at, tile_step(b, i, load(y_ref + at), load(y + at), workspace));
            }
        }
    }
}
