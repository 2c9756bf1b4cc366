/* Cyclic operation, a synchronous Moore machine:   reset -> build -> learn -> reset, with the new weights.
 *
 *     reset    only the operators move on                                         over after so many good samples
 * without a fault build    good samples are counted into the Gram matrix                      over after so many of
 * them learn    one step w <- Proj(w - eta (P w + q)) a sample, or waiting for     over after so many samples the
 * answer of a solver that is not one of steps
 *
 * A phase ends with the block in which its count is reached. The operators follow the actuator in every phase; reset
 * clears P, q and c and never the states. A fault of the sensor sends the machine to reset.
 *
 * Nothing is kept back: new weights are those of all the data, and data that came before have a part in them. With V
 * the mean cost of this cycle's data, V_p that of the cycles before, and w the weights in use, what is solved and what
 * is remembered are
 *
 *     (V + b V_p) / (1 + b),   b = RECALL min(V(w) / V_p(w), V_p(w) / V(w))
 *
 * the one with the w that learning begins with, the other, which takes the place of V_p, with those that it ends with.
 * A cycle that covers other amplitudes or places than the last one does not undo it, but data at odds with each other,
 * a sensor that was zeroed anew or a reference gone wild, are forgotten at once. A cycle whose drive covers less than
 * NARROW of what V_p covers is not remembered, for small movements would lead astray what they hardly excite; but each
 * takes a tenth off what V_p is said to cover.
 *
 * New weights are taken over if the drive of the building phase went through at least MIN_EXCITATION of its range, and
 * if they are finite and explain what they were learned from no worse than those in use: that is what a solver can have
 * done wrong. What the drive did not reach stays as it was, since the problem's reference are the weights in use.
 *
 * Source: the paper's Fig. 1 and equations (3) to (7).
 */
#include "learner.h"

#define RECALL                                                                                                         \
    ((real)0.3) /* part that the cycles before have in a problem, where their data agree with the new ones             \
                 */
#define NARROW ((real)0.8)
#define SHRINKING ((real)0.9)
#define SMALLEST ((real)1e-30) /* costs below are those of rounding */
#define UNDETERMINED                                                                                                   \
    ((real)1e-11) /* share of the largest diagonal entry of P below which rounding decides and not the data */

int64_t cyclic_bytes(Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    const int64_t numbers = 7 * ld + lanes(s) + creep_lanes(s) + LANES + 2 * symmetric_nums(d + 1) + padded(d * d);
    return numbers * (int64_t)sizeof(real) + arena_bytes(descent_bytes(d));
}

Cyclic cyclic_at(Arena *arena, Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    Cyclic c;
    const Extent extents[] = {{&c.reference, ld},
                              {&c.found, ld},
                              {&c.q, ld},
                              {&c.lower, ld},
                              {&c.upper, ld},
                              {&c.start, ld},
                              {&c.scale, ld},
                              {&c.start_play, lanes(s)},
                              {&c.start_creep, creep_lanes(s)},
                              {&c.covered, LANES},
                              {&c.data, symmetric_nums(d + 1)},
                              {&c.past, symmetric_nums(d + 1)},
                              {&c.P, padded(d * d)}};
    LAY_OUT(arena, extents);
    c.descent = descent_at(arena_part(arena, (size_t)descent_bytes(d)));
    c.answer = c.descent.answer;
    return c;
}

void cyclic_enter(const Learner *l, int phase)
{
    const LearnerSettings *const p = l->settings;
    LearnerMemory *const m = l->memory;
    l->clock->phase = phase;
    l->clock->phase_left = phase == RESET       ? p->reset_lasts
                           : phase == BUILD     ? p->build_lasts
                           : SOLVER(p) == STEPS ? p->learn_lasts
                                                : p->solve_lasts;
    if (phase == RESET) {
        memset(l->gram, 0, sizeof(real) * (size_t)symmetric_nums(l->d + 1));
        m->predicted = 0;
        span_clear(m->span, SPAN, 1);
    }
}

/* Position of entry (i, j) of a Gram matrix of the rows (Xi, x); the drive x has index d. */
static int at(int d, int i, int j) { return symmetric_row(d + 1, i < j ? i : j) + (i < j ? j : i); }

/* Half the mean squared error of the unknowns v on a mean Gram matrix. */
static real cost(int d, const real *data, const real *v)
{
    real sum = data[at(d, d, d)] / 2;
    for (int i = 0; i < d; ++i) {
        real gradient = data[at(d, i, d)];
        for (int j = 0; j < d; ++j) {
            gradient += data[at(d, i, j)] * v[j] / 2;
        }
        sum += v[i] * gradient;
    }
    return sum;
}

/* (V + b V_p) / (1 + b) of the weights v into `out`, and V into `now`; `out` may be `now` or the past. */
static void recall(const Learner *l, const real *v, real *now, real *out)
{
    const int entries = symmetric_nums(l->d + 1);
    real b = 0;
    for (int k = 0; k < entries; ++k) {
        now[k] = l->gram[k] / l->memory->predicted;
    }
    if (l->clock->past_share > 0) {
        const real new_cost = greatest(SMALLEST, cost(l->d, now, v));
        const real old_cost = greatest(SMALLEST, cost(l->d, l->cyclic.past, v));
        b = RECALL * (new_cost < old_cost ? new_cost / old_cost : old_cost / new_cost);
    }
    for (int k = 0; k < entries; ++k) {
        out[k] = b > 0 ? (now[k] + b * l->cyclic.past[k]) / (1 + b) : now[k];
    }
}

/* Whether an operator of threshold r that started at z has moved. */
static int moved(const Cyclic *c, real r, real z) { return c->covered[X_HIGH] - r > z || c->covered[X_LOW] + r < z; }

/* Whether the data reached the threshold of unknown j; the others stay where they are. */
static int reached(const Learner *l, int j)
{
    const Shape s = l->shape;
    const Cyclic *const c = &l->cyclic;
    const real *const r = l->regressors.operators.r;
    const int zone = j - s.n, first = zone - s.zones, middle = (int)l->settings->middle;
    if (zone < 0) {
        return moved(c, r[j + 1], c->start_play[j + 1]);
    }
    if (first < 0) {
        return zone == middle
               || (zone > middle ? c->covered[Y_HIGH] > l->regressors.high[zone]
                                 : c->covered[Y_LOW] < l->regressors.low[zone]);
    }
    for (int k = first; first < creep_weights(s) && k < creep_lanes(s); k += lanes(s)) {
        if (moved(c, r[first], c->start_creep[k])) {
            return 1;
        }
    }
    return first == creep_weights(s); /* the constant */
}

/* The program of the data, its variables scaled to unit diagonal, with a proximal term rho |v - v_in_use|^2 / 2. An
 * operator that stood still has a constant column, which a constant or another such column could take over; so the data
 * act on its unknown no more, and the proximal term keeps it where it was. */
static void make_program(const Learner *l)
{
    const Cyclic *const c = &l->cyclic;
    const int d = l->d;
    real *const data = c->data, *const P = c->P, *const held = c->found;
    real largest = 0, trace = 0, rho;
    memcpy(c->reference, l->in_use, sizeof(real) * (size_t)d);
    for (int j = 0; j < d; ++j) {
        const real diagonal = data[at(d, j, j)];
        largest = greatest(diagonal, largest);
        trace += diagonal;
    }
    rho = l->settings->proximal * trace / (real)d;
    for (int j = 0; j < d; ++j) {
        const real diagonal = data[at(d, j, j)];
        const int active = reached(l, j) && diagonal > UNDETERMINED * largest;
        const real whole_diagonal = (active ? diagonal : 0) + rho;
        held[j] = active ? 0 : l->in_use[j];
        c->start[j] = active ? 1 : 0;
        c->scale[j] = whole_diagonal > 0 ? 1 / ROOT(whole_diagonal) : 1;
        P[j * d + j] = whole_diagonal > 0 ? 1 : 0;
    }
    for (int i = 0; i < d; ++i) {
        real q = data[at(d, i, d)];
        for (int j = 0; j < d; ++j) {
            const real p = data[at(d, i, j)];
            q += p * held[j];
            if (i != j) {
                P[i * d + j] = c->start[i] * c->start[j] * p * (c->scale[i] * c->scale[j]);
            }
        }
        c->q[i] = c->scale[i] * (c->start[i] * q - rho * l->in_use[i]);
    }
    for (int j = 0; j < d; ++j) {
        c->lower[j] = lower_bound(l, j) / c->scale[j];
        c->upper[j] = REAL_INFINITY;
        c->start[j] = greatest(l->in_use[j] / c->scale[j], c->lower[j]);
        c->answer[j] = (real)NAN;
    }
}

/* Put the recursion at the start; whether the program can be solved. */
static int begin_steps(const Learner *l)
{
    ProjectedGradient descent = l->cyclic.descent;
    const Cyclic *const c = &l->cyclic;
    if (descent_setup(descent.head, l->d, c->lower, c->upper) != OK
        || descent_set_data(&descent, c->P, c->q, l->settings->step_ratio, 0) != OK) {
        return 0;
    }
    descent_start(&descent, c->start);
    return 1;
}

static int refuse(const Learner *l, int why)
{
    l->memory->refusals += 1;
    cyclic_enter(l, RESET);
    return why;
}

static int end_of_build(const Learner *l, int64_t now)
{
    const Cyclic *const c = &l->cyclic;
    l->clock->learning_since = now;
    memcpy(c->covered, l->memory->span, SPAN * sizeof(real));
    if ((c->covered[X_HIGH] - c->covered[X_LOW]) / 2 < MIN_EXCITATION) {
        return refuse(l, UNEXCITED);
    }
    recall(l, l->in_use, c->data, c->data);
    make_program(l);
    cyclic_enter(l, LEARN);
    return SOLVER(l->settings) != STEPS || begin_steps(l) ? PROGRAM : refuse(l, NOT_A_NUMBER);
}

/* Offer the answer if it passes. */
static int hand_over(const Learner *l, int64_t now)
{
    const Cyclic *const c = &l->cyclic;
    LearnerClock *const clock = l->clock;
    const real share = (c->covered[X_HIGH] - c->covered[X_LOW]) / 2;
    real sum = 0, before, after;
    if (SOLVER(l->settings) == STEPS) {
        ProjectedGradient descent = c->descent;
        descent_answer(&descent);
    }
    for (int j = 0; j < l->d; ++j) {
        const real z = c->answer[j] < c->lower[j] ? c->lower[j] : c->answer[j];
        c->found[j] = z * c->scale[j];
        sum += c->found[j] - c->found[j];
    }
    if (!(sum == 0)) {
        return refuse(l, NOT_A_NUMBER);
    }
    before = greatest(0, cost(l->d, c->data, l->in_use));
    after = greatest(0, cost(l->d, c->data, c->found));
    clock->error_in_use = ROOT(2 * before);
    clock->error_found = ROOT(2 * after);
    if (!(after <= before)) {
        return refuse(l, WORSE);
    }
    if (!learner_offer(l, c->found, 1, 1, now + l->mailbox.head->delay)) {
        return 0; /* the last offer is still waiting for its sample: again with the next block */
    }
    memcpy(l->in_use, c->found, sizeof(real) * (size_t)l->d);
    l->memory->hand_overs += 1;
    if (share < NARROW * clock->past_share) {
        clock->past_share *= SHRINKING;
    } else {
        recall(l, c->found, c->data, c->past);
        clock->past_share = share;
    }
    cyclic_enter(l, RESET);
    return TAKE_OVER;
}

static void count(const Learner *l, const BlockSummary *b)
{
    LearnerMemory *const m = l->memory;
    if (m->predicted == 0 && b->good > 0) {
        const Block first = block_at(&l->mailbox, l->mailbox.head->consumed);
        for (int i = 0; i < lanes(l->shape); ++i) {
            l->cyclic.start_play[i] = play_of((real)first.x[0], l->regressors.operators.r[i], (real)first.play[i]);
        }
        for (int i = 0; i < creep_lanes(l->shape); ++i) {
            l->cyclic.start_creep[i] = (real)first.creep[i];
        }
    }
    m->predicted += b->good;
    span_widen(m->span, b->span, 1);
    learner_add_rows(l, b->count, 1);
}

int cyclic_block(const Learner *l, const BlockSummary *b)
{
    LearnerClock *const clock = l->clock;
    if (clock->phase == LEARN) {
        if (SOLVER(l->settings) == STEPS) {
            ProjectedGradient descent = l->cyclic.descent;
            projected_steps(&descent, b->count, -1);
        }
        clock->phase_left -= b->count;
        const int events = clock->phase_left <= 0 ? hand_over(l, b->end) : 0;
        return events ? events | CYCLE_OVER : 0;
    }
    if (b->fault > 0) {
        const int building = clock->phase == BUILD;
        l->memory->faults += building;
        cyclic_enter(l, RESET);
        return building ? SENSOR_FAULT : 0;
    }
    if (clock->phase == BUILD) {
        count(l, b);
    }
    clock->phase_left -= (int64_t)b->good;
    if (clock->phase_left > 0) {
        return 0;
    }
    if (clock->phase == BUILD) {
        return end_of_build(l, b->end);
    }
    cyclic_enter(l, BUILD);
    return 0;
}
