/* The tiles of a bank: what they consist of, and the compensators of one.
 *
 * The sums of compensator.c run over blocks of eight operators and then over the lanes of a vector. Here an operator is a vector of its
 * own and the lanes are actuators, so the same sums are written out: operator i goes to partial sum i mod 8, and those are added
 * halves onto halves.
 */
#include "bank.h"

#include "bank_learning.h"

#define FARTHEST ((real)1e6) /* as in compensator.c */

enum { TOGETHER = 32 }; /* tiles that go through many samples together: so many stay in the second-level cache */

static int64_t vectors(int count) { return (int64_t)sizeof(real) * LANES * count; }
static int states(Shape s) { return (1 + s.rates) * (s.n + 1); }
static int64_t driver_bytes(Shape s) { return 64 + vectors(states(s) + 4 * (s.n + 1) + s.zones + creep_weights(s) + 1 + 4 + 2); }
static int64_t learner_bytes(Shape s)
{
    const int d = unknowns(s);
    return vectors(states(s) + MEMORY_LENGTH + 2 * d + triangle(d + 1) + 2 * BANK_BLOCK);
}
static int64_t note_bytes(Shape s) { return vectors(2 * (triangle(unknowns(s) + 1) + unknowns(s) + 1)); }

static int64_t parameter_bytes(Shape s)
{
    return room_bytes(sizeof(BankSettings)) + (int64_t)sizeof(real) * padded(states(s) + 4 * s.zones);
}

int64_t bank_bytes(Shape s, int64_t tiles)
{
    return HEAD_BYTES + parameter_bytes(s) + tiles * (driver_bytes(s) + learner_bytes(s) + note_bytes(s));
}

Bank bank_at(void *memory)
{
    Bank b;
    Room room = after_head(memory);
    b.head = memory;
    b.shape = SHAPE(&b.head->shaped);
    b.d = unknowns(b.shape);
    b.settings = room_for(&room, sizeof *b.settings);
    b.r = reals(&room, 1, b.shape.n + 1);
    b.a = reals(&room, 1, b.shape.rates);
    b.zone_low = reals(&room, 1, b.shape.zones);
    b.zone_high = reals(&room, 1, b.shape.zones);
    b.outer_low = reals(&room, 1, b.shape.zones);
    b.outer_high = reals(&room, 1, b.shape.zones);
    b.drivers = (char *)memory + HEAD_BYTES + parameter_bytes(b.shape);
    b.learners = b.drivers + b.head->tiles * driver_bytes(b.shape);
    b.notes = b.learners + b.head->tiles * learner_bytes(b.shape);
    return b;
}

static TileNote take_note(Room *room, int d)
{
    TileNote n;
    n.gram = reals(room, triangle(d + 1), LANES);
    n.in_use = reals(room, d, LANES);
    n.level = reals(room, 1, LANES);
    return n;
}

Tile tile_at(const Bank *b, int64_t tile)
{
    const Shape s = b->shape;
    Tile t;
    Room room = {b->drivers + tile * driver_bytes(s)};
    t.number = (int)tile;
    t.counts = room_for(&room, sizeof *t.counts);
    t.play = reals(&room, s.n + 1, LANES);
    t.creep = reals(&room, s.rates * (s.n + 1), LANES);
    t.w_H = reals(&room, s.n + 1, LANES);
    t.W_H = reals(&room, s.n + 1, LANES);
    t.w_H_inverse = reals(&room, s.n + 1, LANES);
    t.r_H_inverse = reals(&room, s.n + 1, LANES);
    t.w_S = reals(&room, s.zones, LANES);
    t.w_K = reals(&room, creep_weights(s), LANES);
    t.offset = reals(&room, 1, LANES);
    t.limits = reals(&room, 4, LANES);
    t.fade = reals(&room, 2, LANES);
    room.at = b->learners + tile * learner_bytes(s);
    t.old_play = reals(&room, s.n + 1, LANES);
    t.old_creep = reals(&room, s.rates * (s.n + 1), LANES);
    t.memory = reals(&room, MEMORY_LENGTH, LANES);
    t.in_use = reals(&room, b->d, LANES);
    t.candidate = reals(&room, b->d, LANES);
    t.gram = reals(&room, triangle(b->d + 1), LANES);
    t.seen = reals(&room, 2 * BANK_BLOCK, LANES);
    room.at = b->notes + tile * note_bytes(s);
    t.older = take_note(&room, b->d);
    t.newer = take_note(&room, b->d);
    return t;
}

void bank_setup(void *memory, Shape s, int64_t tiles)
{
    const BankHead head = {{BANK_KIND, unknowns(s), bank_bytes(s, tiles), s}, tiles};
    memset(memory, 0, (size_t)head.shaped.bytes);
    memcpy(memory, &head, sizeof head);
}

void tile_invert(const Bank *b, const Tile *t)
{
    vec8 W = load(t->w_H), r_inverse = zeros();
    store(t->W_H, W);
    store(t->w_H_inverse, over(splat(1), W));
    for (int i = 1; i <= b->shape.n; ++i) {
        const vec8 before = W, w = load(lane8(t->w_H, i));
        r_inverse = plus_product(r_inverse, W, splat(b->r[i] - b->r[i - 1]));
        W = add(W, w);
        store(lane8(t->W_H, i), W);
        store(lane8(t->w_H_inverse, i), over(sub(zeros(), w), mul(W, before)));
        store(lane8(t->r_H_inverse, i), r_inverse);
    }
}

/* Eight partial sums, in the order of sum8. */
CORE_INLINE vec8 fold(const vec8 *l)
{
    return add(add(add(l[0], l[4]), add(l[2], l[6])), add(add(l[1], l[5]), add(l[3], l[7])));
}

/* Drive that makes the models' next output y_ref, without any limit; all in unit amplitudes. */
static vec8 wanted_drive(const Bank *b, const Tile *t, vec8 y_ref)
{
    const Shape s = b->shape;
    vec8 creep[LANES], zones[LANES], u, x, outside = zeros();
    for (int l = 0; l < LANES; ++l) {
        creep[l] = zones[l] = zeros();
    }
    for (int j = 0; j < s.rates; ++j) {
        for (int i = 0; i <= s.n; ++i) {
            creep[i % LANES] = plus_product(creep[i % LANES], load(lane8(t->w_K, i)), load(lane8(t->creep, j * (s.n + 1) + i)));
        }
    }
    for (int i = 0; i < s.zones; ++i) {
        const vec8 zone = dead_zone8(y_ref, splat(b->zone_low[i]), splat(b->zone_high[i]));
        zones[i % LANES] = plus_product(zones[i % LANES], load(lane8(t->w_S, i)), zone);
    }
    u = sub(sub(fold(zones), fold(creep)), load(t->offset));
    x = mul(load(t->w_H_inverse), u);
    for (int i = s.n; i > 0; --i) {
        const vec8 play = load(lane8(t->play, i)), z = plus_product(outside, load(lane8(t->W_H, i)), play);
        outside = plus_product(outside, load(lane8(t->w_H, i)), play);
        x = plus_product(x, load(lane8(t->w_H_inverse, i)), play8(u, load(lane8(t->r_H_inverse, i)), z));
    }
    return x;
}

CORE_INLINE vec8 unit_reference(const Bank *b, vec8 y_ref)
{
    const vec8 unit = over(sub(y_ref, splat(b->settings->y_centre)), splat(b->settings->y_scale));
    return larger(smaller(unit, splat(FARTHEST)), splat(-FARTHEST));
}

CORE_INLINE vec8 within(vec8 x, const real *low, const real *high) { return larger(smaller(x, load(high)), load(low)); }

/* What they would drive for their last references at this moment, in unit amplitudes. */
static vec8 drive_now(const Bank *b, const Tile *t)
{
    return within(wanted_drive(b, t, unit_reference(b, load(t->fade + LANES))), lane8(t->limits, 2), lane8(t->limits, 3));
}

/* Take the weights in use of these lanes over without a bump, as of compensator_hand_over. */
static void hand_over(const Bank *b, const Tile *t, vec8 which)
{
    const Shape s = b->shape;
    const int middle = (int)b->settings->middle;
    const real *const slopes = lane8(t->in_use, s.n);
    const vec8 before = drive_now(b, t);
    put_where(which, t->w_H, splat(1));
    for (int i = 0; i < s.n; ++i) {
        put_where(which, lane8(t->w_H, i + 1), load(lane8(t->in_use, i)));
    }
    for (int i = 0; i < s.zones; ++i) {
        const vec8 inner = i == middle ? zeros() : load(slopes + (i > middle ? i - 1 : i + 1) * LANES);
        put_where(which, lane8(t->w_S, i), sub(load(slopes + i * LANES), inner));
    }
    for (int i = 0; i < creep_weights(s); ++i) {
        put_where(which, lane8(t->w_K, i), load(slopes + (s.zones + i) * LANES));
    }
    if (s.offset) {
        put_where(which, t->offset, load(lane8(t->in_use, b->d - 1)));
    }
    tile_invert(b, t);
    put_where(which, t->fade, add(load(t->fade), sub(before, drive_now(b, t))));
}

static vec8 tile_step(const Bank *b, const Tile *t, vec8 y_ref, vec8 y, void *room)
{
    const BankSettings *const p = b->settings;
    const vec8 last = load(t->play), reach = splat(p->max_step), x_centre = splat(p->x_centre), x_scale = splat(p->x_scale);
    const vec8 finite = where_less(magnitude(y_ref), splat(REAL_INFINITY), splat(1), zeros());
    vec8 x, unit;
    if (t->counts->started) {
        const vec8 over_to = observe(b, t, y, room);
        if (sum8(over_to) > 0) {
            hand_over(b, t, over_to);
        }
    }
    t->counts->started = 1;
    put_where(finite, t->fade + LANES, y_ref);
    x = add(wanted_drive(b, t, unit_reference(b, load(t->fade + LANES))), load(t->fade));
    put_where(finite, t->fade, mul(load(t->fade), splat(p->decay)));
    x = larger(smaller(x, add(last, reach)), sub(last, reach));
    x = within(where_less(zeros(), finite, x, last), lane8(t->limits, 2), lane8(t->limits, 3));
    x = within(plus_product(x_centre, x_scale, x), t->limits, lane8(t->limits, 1));
    unit = over(sub(x, x_centre), x_scale);
    advance_lanes(b, unit, t->play, t->creep);
    return x;
}

/* Have the memory on its way that the next step of this tile needs, while the tile before it is at work. */
CORE_INLINE void fetch_tile(const Bank *b, int64_t tile)
{
    const Tile t = tile_at(b, tile);
    const int block = (int)b->settings->block;
    fetch(t.counts, driver_bytes(b->shape));
    if ((t.counts->sample + 1) % block == 0) {
        fetch(t.old_play, learner_bytes(b->shape) - vectors(2 * (BANK_BLOCK - block)));
    }
}

void bank_step(const Bank *b, int64_t first, int64_t last, const real *y_ref, const real *y, real *x, int64_t samples, void *room)
{
    const int64_t width = b->head->tiles * LANES;
    for (int64_t begin = first; begin < last; begin += TOGETHER) {
        const int64_t end = begin + TOGETHER < last ? begin + TOGETHER : last;
        for (int64_t k = 0; k < samples; ++k) {
            for (int64_t i = begin; i < end; ++i) {
                const Tile t = tile_at(b, i);
                const int64_t at = k * width + i * LANES;
                if (i + 1 < last) {
                    fetch_tile(b, i + 1);
                }
                store(x + at, tile_step(b, &t, load(y_ref + at), load(y + at), room));
            }
        }
    }
    finish_optima(b, room);
}
