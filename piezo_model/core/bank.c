#define CORE_TILE
#include "bank.h"

enum { TOGETHER = 32 }; /* tiles that go through many samples together: so many stay in the second-level cache */

static int64_t bytes_of(int64_t count) { return room_bytes((int64_t)sizeof(num) * count); }
static int memory_nums(void) { return (int)(sizeof(DriveMemory) / sizeof(num)); }
static int64_t driver_bytes(Shape s, int block)
{
    return bytes_of(memory_nums() + state_nums(s) + inverse_nums(s)) + mailbox_bytes(s, block, 1);
}
static int64_t learner_part_bytes(Shape s) { return room_bytes(sizeof(LearnerClock)) + bytes_of(learner_nums(s)); }
static int64_t note_bytes(Shape s) { return bytes_of(2 * note_nums(s)); }
static int64_t parameter_bytes(Shape s)
{
    return room_bytes(sizeof(DriveSettings)) + room_bytes(sizeof(LearnerSettings))
        + (int64_t)sizeof(real) * (lanes(s) + rate_lanes(s) + 4 * zone_lanes(s));
}

int64_t bank_bytes(Shape s, int64_t tiles, int block)
{
    return HEAD_BYTES + parameter_bytes(s) + tiles * (driver_bytes(s, block) + learner_part_bytes(s) + note_bytes(s));
}

int64_t bank_room_bytes(Shape s, int block) { return workspace_bytes(s, block, CONTINUOUS) + box_bytes(unknowns(s)); }

Bank bank_at(void *memory)
{
    Bank b;
    Room room = after_head(memory);
    b.head = memory;
    b.shape = SHAPE(&b.head->shaped);
    b.drive_settings = room_for(&room, sizeof *b.drive_settings);
    b.learner_settings = room_for(&room, sizeof *b.learner_settings);
    b.regressors = take_regressors(&room, b.shape);
    b.drivers = (char *)memory + HEAD_BYTES + parameter_bytes(b.shape);
    b.learners = b.drivers + b.head->tiles * driver_bytes(b.shape, b.head->block);
    b.notes = b.learners + b.head->tiles * learner_part_bytes(b.shape);
    return b;
}

Tile tile_at(const Bank *b, int64_t tile, Workspace work)
{
    const Shape s = b->shape;
    Tile t;
    Compensator *const c = &t.controller.compensator;
    Room room = {b->drivers + tile * driver_bytes(s, b->head->block)}, notes = {b->notes + tile * note_bytes(s)};
    c->head = NULL;
    c->shape = s;
    c->settings = b->drive_settings;
    c->operators = b->regressors.operators;
    c->low = b->regressors.low;
    c->high = b->regressors.high;
    c->memory = (DriveMemory *)(void *)nums(&room, memory_nums());
    c->play = nums(&room, play_vectors(s));
    c->creep = nums(&room, creep_vectors(s));
    c->inverse = take_inverse(&room, s);
    t.controller.mailbox = mailbox_at(room.at, s);
    room.at = b->learners + tile * learner_part_bytes(s);
    t.learner.shape = s;
    t.learner.d = unknowns(s);
    t.learner.settings = b->learner_settings;
    t.learner.regressors = b->regressors;
    t.learner.mailbox = t.controller.mailbox;
    t.learner.clock = room_for(&room, sizeof *t.learner.clock);
    t.learner.work = work;
    t.learner.bank = b;
    t.learner.number = (int)tile;
    tile_learner_take(&t.learner, &room, &notes);
    return t;
}

Bank bank_setup(void *memory, Shape s, int64_t tiles, int block)
{
    const BankHead head = {{BANK_KIND, unknowns(s), bank_bytes(s, tiles, block), s}, tiles, block};
    memset(memory, 0, (size_t)head.shaped.bytes);
    memcpy(memory, &head, sizeof head);
    return bank_at(memory);
}

void tile_begin(const Bank *b, int64_t tile, num which)
{
    const Workspace none = {0};
    const Tile t = tile_at(b, tile, none);
    const Compensator *const c = &t.controller.compensator;
    const Learner *const l = &t.learner;
    SensorGuard *const guard = (SensorGuard *)(void *)l->mailbox.guard;
    const Block block = block_at(&l->mailbox, l->mailbox.head->published);
    SensorGuard fresh;
    memset(&fresh, 0, sizeof fresh);
    guard_forget(&fresh);
    copy_where(which, (num *)guard, (const num *)&fresh, (int)(sizeof fresh / sizeof(num)));
    copy_where(which, (num *)block.play, c->play, state_nums(b->shape)); /* play, then creep */
    for (int k = 0; k < b->head->block; ++k) {
        set_where(which, (num *)block.y + k, constant((real)NAN));
    }
    invert(&c->inverse, b->shape, b->regressors.operators.r);
    copy_where(which, l->before, l->in_use, l->d);
    set_where(which, &l->memory->fault_count, from_shared(l->mailbox.faults, 0));
    set_where(which, &l->memory->left, constant((real)l->settings->reset_lasts));
    tile_learner_begin_anew(l, which, constant(0));
}

static num tile_step(const Tile *t, num y_ref, num y)
{
    const Controller *const c = &t->controller;
    if (c->mailbox.head->to_go > 0 && tile_controller_observe(c, c->compensator.play[0], y)) { /* there has been a drive */
        bank_wait(t->learner.bank, &t->learner.work, t->learner.number, t->learner.number);
        tile_learner_learn(&t->learner);
    }
    return tile_controller_drive(c, y_ref);
}

/* Have the memory on its way that the next step of this tile needs, while the tile before it is at work. */
CORE_INLINE void fetch_tile(const Bank *b, int64_t tile)
{
    const Workspace none = {0};
    const Tile t = tile_at(b, tile, none);
    fetch(t.controller.compensator.memory, driver_bytes(b->shape, b->head->block) - block_bytes(b->shape, b->head->block));
    if (t.controller.mailbox.head->to_go == 1) {
        fetch(t.learner.clock, learner_part_bytes(b->shape));
    }
}

void bank_step(const Bank *b, int64_t first, int64_t last, const real *y_ref, const real *y, real *x, int64_t samples, void *room)
{
    const int64_t width = b->head->tiles * LANES;
    const Workspace work = tile_workspace_at(room, b->shape, b->head->block, CONTINUOUS);
    for (int64_t begin = first; begin < last; begin += TOGETHER) {
        const int64_t end = begin + TOGETHER < last ? begin + TOGETHER : last;
        for (int64_t k = 0; k < samples; ++k) {
            for (int64_t i = begin; i < end; ++i) {
                const Tile t = tile_at(b, i, work);
                const int64_t at = k * width + i * LANES;
                if (i + 1 < last) {
                    fetch_tile(b, i + 1);
                }
                store(x + at, tile_step(&t, load(y_ref + at), load(y + at)));
            }
        }
    }
    bank_wait(b, &work, 0, (int)b->head->tiles - 1);
}
