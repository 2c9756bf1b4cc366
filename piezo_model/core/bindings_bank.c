/* The bank as Python calls it; see bank.h. */
#define CORE_TILE
#include "bank.h"
#include "bindings_learner.h"

#define BANK ((Bank[]){bank_at(MEMORY(0))})

/* Initialise a bank and return its parts: the settings, and those of the first tile. The lengths of "driver", "learner"
 * and "checkpoint" are the strides from tile to tile. */
static void set_up(Arguments *a, void *memory, Shape s, int64_t tiles, int block)
{
    const Bank b = bank_setup(memory, s, tiles, block);
    const Controller controller = tile_controller(&b, 0), beside = tile_controller(&b, 1);
    const Compensator *const c = &controller.compensator, *const d = &beside.compensator;
    const Learner learner = tile_learner(&b, 0, NULL), next = tile_learner(&b, 1, NULL), *const l = &learner;
    const Regressors *const p = &b.regressors;
    const Field fields[] = {
        {"drive_settings", b.drive_settings, sizeof *b.drive_settings / sizeof(real)},
        {"settings", b.learner_settings, sizeof *b.learner_settings / sizeof(real)},
        REGRESSOR_PARTS(p, s),
        {"driver", c->memory, (real *)d->memory - (real *)c->memory},
        {"learner", l->clock, (real *)next.clock - (real *)l->clock},
        {"checkpoint", l->checkpoint.gram, (real *)next.checkpoint.gram - (real *)l->checkpoint.gram},
        {"drive_memory", c->memory, sizeof *c->memory / sizeof(real)},
        {"play", c->play, play_vectors(s) * LANES},
        {"creep", c->creep, creep_vectors(s) * LANES},
        {"w_H", c->inverse.w_H, (s.n + 1) * LANES},
        {"w_S", c->inverse.w_S, s.zones * LANES},
        {"w_K", c->inverse.w_K, creep_weights(s) * LANES},
        {"offset", c->inverse.offset, LANES},
        {"prefilter", c->prefilter.reference, prefilter_nums(s) * LANES},
        {"noise_gains", l->mailbox.noise_gains, 2 * LANES},
        {"mailbox", l->mailbox.head, sizeof *l->mailbox.head / sizeof(real)},
        {"clock", l->clock, sizeof *l->clock / sizeof(real)},
        {"memory", l->memory, sizeof *l->memory / sizeof(real)},
        {"in_use", l->in_use, l->d * LANES},
        {"candidate", l->candidate, l->d * LANES},
        {"gram", l->gram, data_nums(s) * LANES}};
    RETURN_FIELDS(memory, fields);
}

/* Whether a tile of unknown origin is safe. */
static int sound(const Bank *b, int64_t tile)
{
    const Controller controller = tile_controller(b, tile);
    const Compensator *const c = &controller.compensator;
    const Learner learner = tile_learner(b, tile, NULL);
    return learner_sound(&learner, b->head->block) && nums_bounded(c->play, state_nums(b->shape))
           && nums_bounded(c->inverse.w_H, inverse_nums(b->shape))
           && nums_bounded((const num *)(const void *)c->prefilter.reference, prefilter_nums(b->shape));
}

/* Restore the state of another bank of the same settings and size, or refuse it and change nothing. */
static void restore(Arguments *a, const Bank *b, void *other)
{
    if (need_bytes(a, 1, b->head->shaped.state.bytes)
        || memcmp(b->head, other, (size_t)(b->drivers - (char *)b->head)) != 0) {
        refuse(a, "it is the state of a bank of another structure, size or settings");
        return;
    }
    const Bank saved = bank_at(other);
    for (int64_t i = 0; i < b->head->tiles; ++i) {
        if (!sound(&saved, i)) {
            refuse(a, "a count or a number in it cannot be");
            return;
        }
    }
    memcpy(b->head, other, (size_t)b->head->shaped.state.bytes);
}

#define BINDINGS(F)                                                                                                    \
    F(bank_bytes, FILTERED ", tiles#0:16777216, block#1:10000", "size of a bank.", 0,                                  \
      WHOLE_RESULT = bank_bytes(FILTERED_AT(0), WHOLE(6), INT(7)))                                                     \
    F(bank_workspace_bytes, FILTERED ", block#1:10000", "size of the workspace that each thread needs.", 0,            \
      WHOLE_RESULT = bank_workspace_bytes(FILTERED_AT(0), INT(6)))                                                     \
    F(bank_setup, "state@, " FILTERED ", tiles#1:16777216, block#1:10000",                                             \
      "make a block a bank; where its parts stand.", NEED_BYTES(0, bank_bytes(FILTERED_AT(1), WHOLE(7), INT(8))),      \
      set_up(&a, MEMORY(0), FILTERED_AT(1), WHOLE(7), INT(8)))                                                         \
    F(bank_prepare, "state@BANL, tile#0:e, late#0:2305843009213693951",                                                \
      "prepare a new tile whose samples are counted from late on.", 0, tile_prepare(BANK, WHOLE(1), WHOLE(2)))         \
    F(bank_restore, "state@BANL, other@", "become what another bank was.", 0, restore(&a, BANK, MEMORY(1)))            \
    F(bank_begin, "state@BANL, tile#0:e, which[8]",                                                                    \
      "lanes where which is 1 learn anew from the weights that they have.", 0,                                         \
      tile_begin(BANK, WHOLE(1), load(REALS(2))))                                                                      \
    F(bank_run, "state@BANL&, y_ref[n,w], y[n,w], x[n,w]=, workspace@, first#0:t, last#0:t",                           \
      "drives of the tiles from first up to last for references, learning from the outputs of the drives before.",     \
      (NEED_SIZE(w, LENGTH(t) * LANES), NEED_BYTES(4, bank_workspace_bytes(BANK->shape, BANK->head->block)),           \
       LENGTH(n) * (WHOLE(6) - WHOLE(5)) > 8),                                                                         \
      bank_step(BANK, WHOLE(5), WHOLE(6), REALS(1), REALS(2), REALS(3), LENGTH(n), MEMORY(4)))
MAKE_BINDINGS(bank)
