/* The bank as Python calls it; see bank.h. */
#define CORE_TILE
#include "bank.h"
#include "face_model.h"

TAKE_STATE(bank, Bank, BANK_KIND)

FACE(bank_bytes)
{
    const Shape s = take_shape(a);
    const int64_t tiles = take_integer(a, 0, 1 << 24);
    const int block = (int)take_integer(a, 1, MOST_OPERATORS);
    return finish_integer(a, good(a) ? bank_bytes(s, tiles, block) : 0);
}

FACE(bank_room_bytes)
{
    const Shape s = take_shape(a);
    const int block = (int)take_integer(a, 1, MOST_OPERATORS);
    return finish_integer(a, good(a) ? bank_room_bytes(s, block) : 0);
}

/* Where the settings and the parts of the first tile stand; "driver", "learner" and "note" are what it has of each part
 * of the bank. */
FACE(bank_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    const int64_t tiles = take_integer(a, 1, 1 << 24);
    const int block = (int)take_integer(a, 1, MOST_OPERATORS);
    if (good(a)) {
        need_bytes(a, 0, bank_bytes(s, tiles, block));
    }
    if (!good(a)) {
        return finish(a, NULL);
    }
    const Bank b = bank_setup(memory, s, tiles, block);
    const Controller controller = tile_controller(&b, 0), beside = tile_controller(&b, 1);
    const Compensator *const c = &controller.compensator, *const d = &beside.compensator;
    const Learner learner = tile_learner(&b, 0, NULL), next = tile_learner(&b, 1, NULL), *const l = &learner;
    const Regressors *const p = &b.regressors;
    const Part parts[] = {{"drive_settings", b.drive_settings, sizeof *b.drive_settings / sizeof(real)},
                          {"settings", b.learner_settings, sizeof *b.learner_settings / sizeof(real)},
                          {"r", p->operators.r, lanes(s)},
                          {"a", p->operators.a, s.rates},
                          {"low", p->low, zone_lanes(s)},
                          {"high", p->high, zone_lanes(s)},
                          {"outer_low", p->outer_low, zone_lanes(s)},
                          {"outer_high", p->outer_high, zone_lanes(s)},
                          {"driver", c->memory, (real *)d->memory - (real *)c->memory},
                          {"learner", l->clock, (real *)next.clock - (real *)l->clock},
                          {"note", l->older.gram, (real *)next.older.gram - (real *)l->older.gram},
                          {"drive_memory", c->memory, sizeof *c->memory / sizeof(real)},
                          {"play", c->play, play_vectors(s) * LANES},
                          {"creep", c->creep, creep_vectors(s) * LANES},
                          {"w_H", c->inverse.w_H, (s.n + 1) * LANES},
                          {"w_S", c->inverse.w_S, s.zones * LANES},
                          {"w_K", c->inverse.w_K, creep_weights(s) * LANES},
                          {"offset", c->inverse.offset, LANES},
                          {"mailbox", l->mailbox.head, sizeof *l->mailbox.head / sizeof(real)},
                          {"clock", l->clock, sizeof *l->clock / sizeof(real)},
                          {"memory", l->memory, sizeof *l->memory / sizeof(real)},
                          {"in_use", l->in_use, l->d * LANES},
                          {"candidate", l->candidate, l->d * LANES},
                          {"gram", l->gram, symmetric_nums(l->d + 1) * LANES}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

FACE(bank_prepare)
{
    Bank b = take_bank(a);
    const int64_t tile = take_integer(a, 0, good(a) ? b.head->tiles - 1 : 0);
    const int64_t late = take_integer(a, 0, INT64_MAX / 4);
    if (good(a)) {
        tile_prepare(&b, tile, late);
    }
    return finish_integer(a, 0);
}

static int all_finite(const num *v, int count)
{
    real sum = 0;
    for (int i = 0; i < count * LANES; ++i) {
        sum += ((const real *)v)[i] - ((const real *)v)[i]; /* 0, or NaN */
    }
    return sum == 0;
}

/* Whether a tile from outside could be followed: counts within their bounds, numbers finite that have to be. */
static int sound(const Bank *b, int64_t tile)
{
    const Controller controller = tile_controller(b, tile);
    const Compensator *const c = &controller.compensator;
    const Learner learner = tile_learner(b, tile, NULL), *const l = &learner;
    const MailboxHead *const m = l->mailbox.head;
    const int fine = m->block == b->head->block && m->blocks == 1 && m->place == 0 && m->delay == m->block
                     && m->samples >= 0 && m->filled >= 0 && m->to_go >= 0 && m->filled + m->to_go <= m->block
                     && m->skipped >= 0 && m->skipped < m->block && m->published == m->consumed
                     && m->offered - m->answered <= 1 && l->clock->next_interval >= 0;
    return fine && all_finite(c->play, play_vectors(b->shape)) && all_finite(c->creep, creep_vectors(b->shape))
           && all_finite(c->inverse.w_H, inverse_nums(b->shape)) && all_finite(l->in_use, 3 * NUMS(l->d))
           && all_finite(l->gram, symmetric_nums(l->d + 1)) && all_finite(l->older.gram, 2 * note_nums(b->shape))
           && all_finite((const num *)(const void *)l->mailbox.offer.inverse, inverse_nums(b->shape));
}

/* Become what another bank of the same settings and number of tiles was; nothing is changed where that cannot be. */
FACE(bank_restore)
{
    Bank b = take_bank(a);
    void *const other = take_state(a, BANK_KIND);
    if (!good(a)) {
        return finish(a, NULL);
    }
    if (a->views[1].len < b.head->shaped.bytes || memcmp(b.head, other, (size_t)(b.drivers - (char *)b.head)) != 0) {
        refuse(a, "it is the state of a bank of another structure, size or settings");
        return finish(a, NULL);
    }
    const Bank found = bank_at(other);
    for (int64_t i = 0; good(a) && i < b.head->tiles; ++i) {
        if (!sound(&found, i)) {
            refuse(a, "a count or a number in it cannot be");
        }
    }
    if (good(a)) {
        memcpy(b.head, other, (size_t)b.head->shaped.bytes);
    }
    return finish_integer(a, 0);
}

/* Make the lanes of a tile where `which` is 1 begin anew with the weights that stand in it. */
FACE(bank_begin)
{
    Bank b = take_bank(a);
    const int64_t tile = take_integer(a, 0, good(a) ? b.head->tiles - 1 : 0);
    const double *const which = take_array(a, VECTOR, LANES);
    if (good(a)) {
        tile_begin(&b, tile, load(which));
    }
    return finish_integer(a, 0);
}

/* Drives (N, 8 tiles) for references, from tile `first` up to `last`; y are the outputs of the drives before. */
FACE(bank_run)
{
    Bank b = take_bank(a);
    const int width = good(a) ? (int)b.head->tiles * LANES : 0;
    const double *const y_ref = take_array(a, ANY_LENGTH, width);
    const int samples = (int)taken_length(a);
    const double *const y = take_array(a, samples, width);
    double *const x = take_output(a, samples, width);
    void *const room = take_state(a, 0);
    if (good(a)) {
        need_bytes(a, 4, bank_room_bytes(b.shape, b.head->block));
    }
    const int64_t first = take_integer(a, 0, good(a) ? b.head->tiles : 0);
    const int64_t last = take_integer(a, first, good(a) ? b.head->tiles : 0);
    if (good(a)) {
        begin_long_if(a, samples * (last - first) > 8);
        bank_step(&b, first, last, y_ref, y, x, samples, room);
    }
    return finish_integer(a, 0);
}
