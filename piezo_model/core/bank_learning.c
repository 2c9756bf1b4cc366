/* Learning by blocks in eight lanes, as continuous.h has it by samples: reset, learn, hand over, fall back after a fault.
 *
 * A block goes by in three steps: forwards through its samples, where the guard of each sensor judges and each good sample leaves a
 * row (a sample that is not good leaves zeros); the learners' decisions on the block as a whole; backwards through the rows, each of
 * which gets the root of its weight, and into the Gram matrix. bank_optimum.c finds the optimum of an interval.
 */
#include "bank_learning.h"

/* As in continuous.c. */
#define MIN_EXCITATION ((real)0.02)
#define BELIEF ((real)1e-6)
#define TRUST ((real)5)
#define TOLERANCE ((real)2e-3)

enum { ROW_TILE = PARTS == 1 ? 4 : 2 }; /* rows and columns of the Gram matrix that are summed at a time */

CORE_INLINE int row_length(int d) { return (d + 1 + ROW_TILE - 1) / ROW_TILE * ROW_TILE; }

static Workspace workspace_at(const Bank *b, void *memory)
{
    const int d = b->d, operators = b->shape.n + 1;
    Workspace w;
    Room room = {memory};
    w.rows = reals(&room, BANK_BLOCK * row_length(d), LANES);
    w.good = reals(&room, BANK_BLOCK, LANES);
    w.play = reals(&room, operators, LANES);
    w.creep = reals(&room, b->shape.rates * operators, LANES);
    w.program = box_lanes_at(&room, d);
    w.queue = box_lanes_at(&room, d);
    w.owner = integers(&room, LANES);
    w.rounds = integers(&room, LANES);
    w.P = reals(&room, d, d);
    w.q = reals(&room, 1, d);
    w.lb = reals(&room, 1, d);
    w.ub = reals(&room, 1, d);
    room.at = (char *)memory + (room.at - (char *)memory + 63) / 64 * 64;
    w.single = room.at;
    return w;
}

int64_t bank_room_bytes(Shape s)
{
    const int d = unknowns(s), operators = s.n + 1;
    const int64_t vectors = BANK_BLOCK * (row_length(d) + 1) + (1 + s.rates) * operators + 2;
    return (int64_t)sizeof(real) * (LANES * vectors + 2 * box_lanes_numbers(d) + d * d + 3 * d) + 64 + box_bytes(d);
}

CORE_INLINE vec8 flag(vec8 a, vec8 b) { return where_less(a, b, splat(1), zeros()); } /* a < b */
CORE_INLINE vec8 neither(vec8 a) { return sub(splat(1), a); }

void tile_begin_anew(const Bank *b, const Tile *t, vec8 which, vec8 level)
{
    const int d = b->d;
    const real half_window = (real)b->settings->half_window;
    for (int i = 0; i <= d; ++i) {
        real *const row = lane8(t->gram, triangle_row(d + 1, i));
        for (int j = i; j <= d; ++j) {
            vec8 entry = splat(j == i && i < d ? BELIEF : 0);
            if (j == d && i < d) {
                entry = mul(splat(-BELIEF), larger(load(lane8(t->in_use, i)), splat(lower_bound(b, i))));
            }
            put_where(which, row + j * LANES, entry);
        }
    }
    copy_where(which, t->candidate, t->in_use, d);
    put_where(which, MEMORY(LEVEL), level);
    put_where(which, MEMORY(ESTABLISHED), zeros());
    put_where(which, MEMORY(REVERT), zeros());
    put_where(which, MEMORY(IN_HALF), zeros());
    put_where(which, MEMORY(WAIT), mul(load(MEMORY(NOTED)), splat(half_window)));
    put_where(which, MEMORY(LOW), splat(REAL_INFINITY));
    put_where(which, MEMORY(LOW_BEFORE), splat(REAL_INFINITY));
    put_where(which, MEMORY(HIGH), splat(-REAL_INFINITY));
    put_where(which, MEMORY(HIGH_BEFORE), splat(-REAL_INFINITY));
}

/* The rules of sensor_guard.h: 1 where a sample is good; in `fault` 1 where it is refused or has jumped. */
static vec8 judge(const Tile *t, vec8 x, vec8 y, vec8 *fault)
{
    const vec8 last_x = load(MEMORY(LAST_X)), last_y = load(MEMORY(LAST_Y));
    const vec8 begun = flag(magnitude(last_x), splat(REAL_INFINITY)), there = flag(magnitude(y), splat(REAL_INFINITY));
    const vec8 way = choose(begun, add(load(MEMORY(WAY)), magnitude(sub(x, last_x))), load(MEMORY(WAY)));
    const vec8 low = choose(begun, smaller(x, load(MEMORY(X_LOWEST))), x), high = choose(begun, larger(x, load(MEMORY(X_HIGHEST))), x);
    const vec8 plausible = mul(there, neither(flag(splat(PLAUSIBLE), magnitude(y))));
    const vec8 moved = larger(flag(y, last_y), flag(last_y, y)), known = flag(magnitude(last_y), splat(REAL_INFINITY));
    const vec8 same = mul(plausible, mul(known, neither(moved))), changed = mul(plausible, neither(same));
    const vec8 frozen = mul(same, flag(splat(FROZEN_DRIVE), sub(high, low)));
    const vec8 jumped = mul(changed, flag(plus_product(splat(JUMP), splat(FOLLOWING), way), magnitude(sub(y, last_y))));
    store(MEMORY(LAST_X), x);
    store(MEMORY(LAST_Y), choose(changed, y, last_y));
    store(MEMORY(WAY), choose(changed, zeros(), way));
    store(MEMORY(X_LOWEST), choose(changed, x, low));
    store(MEMORY(X_HIGHEST), choose(changed, x, high));
    *fault = add(mul(there, neither(plausible)), add(frozen, jumped));
    return mul(plausible, neither(add(frozen, jumped)));
}

/* The row (Xi, x) of a sample, zeros where it is not good. */
static void write_row(const Bank *b, const Workspace *w, vec8 good, vec8 x, vec8 y, real *row)
{
    const Shape s = b->shape;
    const int operators = s.n + 1;
    int column = s.n;
    for (int i = 0; s.rates > 0 && i < operators; ++i) {
        vec8 total = zeros();
        for (int j = 0; j < s.rates; ++j) {
            total = add(total, load(lane8(w->creep, j * operators + i)));
        }
        store(lane8(row, s.n + s.zones + i), mul(good, total));
    }
    advance_lanes(b, x, w->play, w->creep);
    for (int i = 0; i < s.n; ++i) {
        store(lane8(row, i), mul(good, load(lane8(w->play, i + 1))));
    }
    y = choose(good, y, zeros());
    for (int i = 0; i < s.zones; ++i, ++column) {
        const vec8 inner = dead_zone8(y, splat(b->zone_low[i]), splat(b->zone_high[i]));
        const vec8 outer = dead_zone8(y, splat(b->outer_low[i]), splat(b->outer_high[i]));
        store(lane8(row, column), mul(good, sub(outer, inner)));
    }
    if (s.offset) {
        store(lane8(row, b->d - 1), good);
    }
    store(lane8(row, b->d), mul(good, x));
    for (int i = b->d + 1; i < row_length(b->d); ++i) {
        store(lane8(row, i), zeros());
    }
}

/* What a block was. */
typedef struct {
    vec8 good, fault, low, high, squares_in_use, squares_candidate;
} Block;

static Block go_through(const Bank *b, const Tile *t, const Workspace *w, int samples)
{
    const int d = b->d;
    Block block = {zeros(), zeros(), splat(REAL_INFINITY), splat(-REAL_INFINITY), zeros(), zeros()};
    memcpy(w->play, t->old_play, sizeof(real) * LANES * (size_t)(b->shape.n + 1));
    memcpy(w->creep, t->old_creep, sizeof(real) * LANES * (size_t)(b->shape.rates * (b->shape.n + 1)));
    for (int k = 0; k < samples; ++k) {
        real *const row = lane8(w->rows, k * row_length(d));
        const vec8 x = load(lane8(t->seen, 2 * k)), y = load(lane8(t->seen, 2 * k + 1));
        vec8 fault, in_use, candidate;
        const vec8 good = judge(t, x, y, &fault);
        write_row(b, w, good, x, y, row);
        in_use = candidate = load(lane8(row, d));
        for (int i = 0; i < d; ++i) {
            const vec8 entry = load(lane8(row, i));
            in_use = plus_product(in_use, entry, load(lane8(t->in_use, i)));
            candidate = plus_product(candidate, entry, load(lane8(t->candidate, i)));
        }
        store(lane8(w->good, k), good);
        block.good = add(block.good, good);
        block.fault = larger(block.fault, fault);
        block.low = choose(good, smaller(x, block.low), block.low);
        block.high = choose(good, larger(x, block.high), block.high);
        block.squares_in_use = plus_product(block.squares_in_use, in_use, in_use);
        block.squares_candidate = plus_product(block.squares_candidate, candidate, candidate);
    }
    return block;
}

/* gram <- lambda^good gram + the rows with their weights, in the lanes that learn. */
static void add_rows(const Bank *b, const Tile *t, const Workspace *w, int samples, vec8 learns)
{
    const int d = b->d, length = row_length(d);
    const vec8 forgetting = splat(b->settings->forgetting), root_step = splat(ROOT(b->settings->forgetting));
    vec8 root = mul(learns, splat(ROOT(1 - b->settings->forgetting))), faded = splat(1);
    for (int k = samples - 1; k >= 0; --k) {
        real *const row = lane8(w->rows, k * length);
        const vec8 counts = mul(learns, load(lane8(w->good, k)));
        for (int i = 0; i <= d; ++i) {
            store(lane8(row, i), mul(root, load(lane8(row, i))));
        }
        root = choose(counts, mul(root, root_step), root);
        faded = choose(counts, mul(faded, forgetting), faded);
    }
    for (int i = 0; i <= d; i += ROW_TILE) {
        for (int j = i; j <= d; j += ROW_TILE) {
            vec8 sum[ROW_TILE][ROW_TILE];
            for (int p = 0; p < ROW_TILE; ++p) {
                for (int q = 0; q < ROW_TILE; ++q) {
                    sum[p][q] = zeros();
                }
            }
            for (int k = 0; k < samples; ++k) {
                const real *const left = lane8(w->rows, k * length + i), *const right = lane8(w->rows, k * length + j);
                for (int p = 0; p < ROW_TILE; ++p) {
                    const vec8 entry = load(left + p * LANES);
                    for (int q = 0; q < ROW_TILE; ++q) {
                        sum[p][q] = plus_product(sum[p][q], entry, load(right + q * LANES));
                    }
                }
            }
            for (int p = 0; p < ROW_TILE; ++p) {
                real *const row = lane8(t->gram, triangle_row(d + 1, i + p) + j);
                for (int q = 0; q < ROW_TILE; ++q) {
                    if (j + q >= i + p && j + q <= d) { /* a column is never left of the row's own in memory that is not the row's */
                        store(row + q * LANES, add(mul(load(row + q * LANES), faded), sum[p][q]));
                    }
                }
            }
        }
    }
}

/* Enter a phase: reset for so many samples, none to learn. */
static void enter(const Tile *t, vec8 which, real samples)
{
    put_where(which, MEMORY(LEFT), splat(samples));
    put_where(which, MEMORY(PROBATION), zeros());
    put_where(which, MEMORY(PREDICTED), zeros());
    put_where(which, MEMORY(SQUARES_IN_USE), zeros());
    put_where(which, MEMORY(SQUARES_CANDIDATE), zeros());
}

static void fall_back(const Bank *b, const Tile *t, vec8 which)
{
    const vec8 noted = mul(which, load(MEMORY(NOTED)));
    copy_where(noted, t->gram, t->older.gram, triangle(b->d + 1));
    copy_where(noted, t->candidate, t->older.in_use, b->d);
    copy_where(noted, MEMORY(LEVEL), t->older.level, 1);
    put_where(noted, MEMORY(ESTABLISHED), splat(1));
    put_where(noted, MEMORY(REVERT), splat(1));
    copy_where(noted, t->newer.gram, t->older.gram, triangle(b->d + 1) + b->d + 1);
    tile_begin_anew(b, t, mul(which, neither(noted)), zeros());
}

/* Note the present state; what was noted last becomes what is gone back to, at the first time at once. */
static void note(const Bank *b, const Tile *t, vec8 which)
{
    const vec8 first = mul(which, neither(load(MEMORY(NOTED)))), again = mul(which, load(MEMORY(NOTED)));
    copy_where(again, t->older.gram, t->newer.gram, triangle(b->d + 1) + b->d + 1);
    copy_where(which, t->newer.gram, t->gram, triangle(b->d + 1));
    copy_where(which, t->newer.in_use, t->in_use, b->d);
    copy_where(which, t->newer.level, MEMORY(LEVEL), 1);
    copy_where(first, t->older.gram, t->newer.gram, triangle(b->d + 1) + b->d + 1);
    put_where(which, MEMORY(NOTED), splat(1));
}

/* Samples have been good for long enough: is it the sensor that it was before the fault? */
static void end_probation(const Bank *b, const Tile *t, vec8 which)
{
    const vec8 lasted = sub(splat((real)b->settings->reset_lasts), load(MEMORY(LEFT)));
    const vec8 error = over(load(MEMORY(PROBATION)), lasted), level = load(MEMORY(LEVEL)), noted = load(MEMORY(NOTED));
    /* sqrt(e) > T sqrt(l) + tau  iff  s = e - T^2 l - tau^2 > 0 and s^2 > 4 T^2 tau^2 l */
    const vec8 s = sub(sub(error, mul(splat(TRUST * TRUST), level)), splat(TOLERANCE * TOLERANCE));
    const vec8 beyond = mul(flag(zeros(), s), flag(mul(splat(4 * TRUST * TRUST * TOLERANCE * TOLERANCE), level), mul(s, s)));
    const vec8 other = mul(which, mul(noted, beyond));
    put_where(mul(which, neither(noted)), MEMORY(LEVEL), error);
    if (sum8(other) > 0) {
        tile_begin_anew(b, t, other, error);
    }
    enter(t, which, 0);
}

/* 1 where the drive of this half window and the one before says enough; takes the block into account. */
static vec8 excites(const Bank *b, const Tile *t, const Block *block, vec8 learns)
{
    const vec8 low = smaller(block->low, load(MEMORY(LOW))), high = larger(block->high, load(MEMORY(HIGH)));
    const vec8 span = sub(larger(high, load(MEMORY(HIGH_BEFORE))), smaller(low, load(MEMORY(LOW_BEFORE))));
    const vec8 filled = add(load(MEMORY(IN_HALF)), block->good), whole = splat((real)b->settings->half_window);
    const vec8 over = mul(learns, neither(flag(filled, whole)));
    put_where(learns, MEMORY(IN_HALF), filled);
    put_where(learns, MEMORY(LOW), low);
    put_where(learns, MEMORY(HIGH), high);
    put_where(over, MEMORY(LOW_BEFORE), low);
    put_where(over, MEMORY(HIGH_BEFORE), high);
    put_where(over, MEMORY(LOW), splat(REAL_INFINITY));
    put_where(over, MEMORY(HIGH), splat(-REAL_INFINITY));
    put_where(over, MEMORY(IN_HALF), zeros());
    return neither(flag(span, splat(2 * MIN_EXCITATION)));
}

/* Hand over where the candidate has predicted at least as well, and find the next one; 1 where the weights in use are new. */
static vec8 end_interval(const Bank *b, const Tile *t, Workspace *w, vec8 looked_at, vec8 excited)
{
    const vec8 reverts = mul(looked_at, load(MEMORY(REVERT)));
    const vec8 judged = mul(mul(looked_at, neither(reverts)), flag(zeros(), load(MEMORY(PREDICTED))));
    const vec8 in_use = load(MEMORY(SQUARES_IN_USE)), candidate = load(MEMORY(SQUARES_CANDIDATE));
    const vec8 better = mul(flag(candidate, splat(REAL_INFINITY)), neither(flag(in_use, candidate)));
    const vec8 waits = flag(zeros(), load(MEMORY(WAIT)));
    const vec8 takes = mul(judged, mul(better, mul(excited, neither(waits))));
    const vec8 first = mul(takes, neither(load(MEMORY(ESTABLISHED)))), fresh = add(reverts, takes);
    copy_where(fresh, t->in_use, t->candidate, b->d);
    store(MEMORY(HAND_OVERS), add(load(MEMORY(HAND_OVERS)), takes));
    store(MEMORY(REFUSALS), add(load(MEMORY(REFUSALS)), mul(judged, neither(better))));
    put_where(takes, MEMORY(ESTABLISHED), splat(1));
    put_where(reverts, MEMORY(REVERT), zeros());
    put_where(reverts, MEMORY(LEFT), splat((real)b->settings->reset_lasts));
    put_where(reverts, MEMORY(PROBATION), zeros());
    if (sum8(judged) > 0) {
        find_optima(b, t, w, judged);
    }
    put_where(looked_at, MEMORY(SQUARES_IN_USE), zeros());
    put_where(looked_at, MEMORY(SQUARES_CANDIDATE), zeros());
    put_where(looked_at, MEMORY(PREDICTED), zeros());
    if (t->counts->sample % b->settings->checkpoint == 0) {
        const vec8 in_phase = neither(flag(zeros(), load(MEMORY(LEFT))));
        note(b, t, mul(mul(looked_at, in_phase), mul(load(MEMORY(ESTABLISHED)), neither(first))));
    }
    return fresh;
}

static vec8 end_block(const Bank *b, const Tile *t, Workspace *w, int samples)
{
    const BankSettings *const p = b->settings;
    const vec8 on = load(MEMORY(LEARNING)), resets = flag(zeros(), load(MEMORY(LEFT)));
    const Block block = go_through(b, t, w, samples);
    const vec8 whole = mul(on, neither(block.fault)), failed = mul(on, mul(block.fault, neither(resets)));
    const vec8 probed = mul(whole, resets), in_phase = mul(whole, neither(resets)), started = flag(zeros(), block.good);
    const vec8 excited = excites(b, t, &block, in_phase);
    const vec8 learns = mul(mul(in_phase, started), larger(excited, neither(load(MEMORY(ESTABLISHED)))));
    const vec8 smooth = smaller(mul(splat(p->smoothing), block.good), splat(1));
    vec8 ended;
    put_where(mul(on, mul(resets, block.fault)), MEMORY(LEFT), splat((real)p->reset_lasts));
    put_where(mul(on, mul(resets, block.fault)), MEMORY(PROBATION), zeros());
    if (sum8(failed) > 0) {
        store(MEMORY(FAULTS), add(load(MEMORY(FAULTS)), failed));
        fall_back(b, t, failed);
        enter(t, failed, (real)p->reset_lasts);
    }
    put_where(probed, MEMORY(PROBATION), add(load(MEMORY(PROBATION)), block.squares_in_use));
    put_where(probed, MEMORY(LEFT), sub(load(MEMORY(LEFT)), block.good));
    ended = mul(probed, neither(flag(zeros(), load(MEMORY(LEFT)))));
    if (sum8(ended) > 0) {
        end_probation(b, t, ended);
    }
    if (sum8(learns) > 0) {
        const vec8 level = load(MEMORY(LEVEL)), mean = over(block.squares_in_use, larger(block.good, splat(1)));
        put_where(learns, MEMORY(LEVEL), plus_product(level, smooth, sub(mean, level)));
        put_where(learns, MEMORY(SQUARES_IN_USE), add(load(MEMORY(SQUARES_IN_USE)), block.squares_in_use));
        put_where(learns, MEMORY(SQUARES_CANDIDATE), add(load(MEMORY(SQUARES_CANDIDATE)), block.squares_candidate));
        put_where(learns, MEMORY(PREDICTED), add(load(MEMORY(PREDICTED)), block.good));
        put_where(learns, MEMORY(WAIT), larger(sub(load(MEMORY(WAIT)), block.good), zeros()));
        add_rows(b, t, w, samples, learns);
    }
    if (t->counts->sample % p->interval == 0) { /* an interval that ends with the phase is not looked at */
        return end_interval(b, t, w, mul(on, neither(add(failed, ended))), excited);
    }
    return zeros();
}

vec8 observe(const Bank *b, const Tile *t, vec8 y, void *room)
{
    const Shape s = b->shape;
    const BankSettings *const p = b->settings;
    const int at = (int)t->counts->waiting;
    vec8 fresh = zeros();
    store(lane8(t->seen, 2 * at), load(t->play)); /* the play of threshold 0 is the drive */
    store(lane8(t->seen, 2 * at + 1), over(sub(y, splat(p->y_centre)), splat(p->y_scale)));
    ++t->counts->waiting;
    ++t->counts->sample;
    if (t->counts->sample % p->block == 0) {
        if (sum8(load(MEMORY(LEARNING))) > 0) {
            Workspace w = workspace_at(b, room);
            wait_for_optima(b, &w, t->number, t->number);
            fresh = end_block(b, t, &w, at + 1);
        }
        memcpy(t->old_play, t->play, sizeof(real) * LANES * (size_t)(s.n + 1));
        memcpy(t->old_creep, t->creep, sizeof(real) * LANES * (size_t)(s.rates * (s.n + 1)));
        t->counts->waiting = 0;
    }
    return fresh;
}

void finish_optima(const Bank *b, void *room)
{
    const Workspace w = workspace_at(b, room);
    wait_for_optima(b, &w, 0, (int)b->head->tiles - 1);
}
