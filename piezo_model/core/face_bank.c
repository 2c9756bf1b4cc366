/* The bank as Python calls it; see bank.h. */
#include "bank.h"
#include "face_model.h"

TAKE_STATE(bank, Bank, BANK_KIND)

FACE(bank_bytes)
{
    const Shape s = take_shape(a);
    const int64_t tiles = take_integer(a, 0, 1 << 24);
    return finish_integer(a, good(a) ? bank_bytes(s, tiles) : 0);
}

FACE(bank_room_bytes) { return size_for(bank_room_bytes, a); }

/* Where the settings and the parts of the first tile stand; "driver", "learner" and "note" are what it has of each part of the bank. */
FACE(bank_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    const int64_t tiles = take_integer(a, 1, 1 << 24);
    if (good(a)) {
        need_bytes(a, 0, bank_bytes(s, tiles));
    }
    if (!good(a)) {
        return finish(a, NULL);
    }
    bank_setup(memory, s, tiles);
    Bank b = bank_at(memory);
    const Tile t = tile_at(&b, 0), next = tile_at(&b, 1);
    const Py_ssize_t operators = s.n + 1, creep = s.rates * operators, entries = triangle(b.d + 1);
    const Part parts[] = {
        {"settings", b.settings, sizeof *b.settings / sizeof(real)}, {"r", b.r, operators}, {"a", b.a, s.rates},
        {"zone_low", b.zone_low, s.zones}, {"zone_high", b.zone_high, s.zones}, {"outer_low", b.outer_low, s.zones},
        {"outer_high", b.outer_high, s.zones}, {"driver", t.counts, (real *)next.counts - (real *)t.counts},
        {"learner", t.old_play, next.old_play - t.old_play}, {"note", t.older.gram, next.older.gram - t.older.gram},
        {"counts", t.counts, LANES}, {"play", t.play, operators * LANES}, {"creep", t.creep, creep * LANES},
        {"w_H", t.w_H, operators * LANES}, {"w_S", t.w_S, s.zones * LANES}, {"w_K", t.w_K, creep_weights(s) * LANES},
        {"offset", t.offset, LANES}, {"limits", t.limits, 4 * LANES}, {"fade", t.fade, 2 * LANES},
        {"seen", t.seen, 2 * BANK_BLOCK * LANES},
        {"old_play", t.old_play, operators * LANES}, {"old_creep", t.old_creep, creep * LANES},
        {"memory", t.memory, MEMORY_LENGTH * LANES}, {"in_use", t.in_use, b.d * LANES}, {"candidate", t.candidate, b.d * LANES},
        {"gram", t.gram, entries * LANES}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

/* Make the lanes of a tile where `which` is 1 begin anew with the weights that stand in it. */
FACE(bank_begin)
{
    Bank b = take_bank(a);
    const int64_t tile = take_integer(a, 0, good(a) ? b.head->tiles - 1 : 0);
    const double *const which = take_array(a, VECTOR, LANES);
    if (good(a)) {
        const Tile t = tile_at(&b, tile);
        tile_invert(&b, &t);
        tile_begin_anew(&b, &t, load(which), zeros());
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
        need_bytes(a, 4, bank_room_bytes(b.shape));
    }
    const int64_t first = take_integer(a, 0, good(a) ? b.head->tiles : 0);
    const int64_t last = take_integer(a, first, good(a) ? b.head->tiles : 0);
    if (good(a)) {
        begin_long_if(a, samples * (last - first) > 8);
        bank_step(&b, first, last, y_ref, y, x, samples, room);
    }
    return finish_integer(a, 0);
}
