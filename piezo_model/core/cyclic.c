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

enum { X_MIN, X_MAX, Y_MIN, Y_MAX };

static int products(Shape s) { return row_width(s) * (row_width(s) + 1) / 2; }

int64_t cyclic_bytes(Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    const int64_t numbers = 7 * ld + lanes(s) + creep_lanes(s) + LANES + 2 * padded(products(s)) + padded(d * d);
    return numbers * (int64_t)sizeof(real) + arena_bytes(descent_bytes(d));
}

Cyclic cyclic_at(Arena *arena, Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    Cyclic c;
    const int all = padded(products(s));
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
                              {&c.data, all},
                              {&c.past, all},
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
        m->span[X_MIN] = m->span[Y_MIN] = REAL_INFINITY;
        m->span[X_MAX] = m->span[Y_MAX] = -REAL_INFINITY;
    }
}

/* Where entry (i, j) of the products is in their triangle. */
static int at(Shape s, int i, int j)
{
    const int low = i < j ? i : j, high = i < j ? j : i;
    return low * row_width(s) - low * (low - 1) / 2 + high - low;
}

/* Half the mean squared error of the unknowns v on mean products. */
static real cost(Shape s, const real *data, const real *v)
{
    real sum = data[at(s, 0, 0)] / 2;
    for (int i = 0; i < unknowns(s); ++i) {
        real gradient = data[at(s, 0, i + 1)];
        for (int j = 0; j < unknowns(s); ++j) {
            gradient += data[at(s, i + 1, j + 1)] * v[j] / 2;
        }
        sum += v[i] * gradient;
    }
    return sum;
}

/* Entry (i, j) of this cycle's mean products; x stands first here and last in the Gram matrix. */
static real mean_product(const Learner *l, int i, int j)
{
    const int a = i == 0 ? l->d : i - 1, b = j == 0 ? l->d : j - 1;
    return l->gram[symmetric_row(l->d + 1, a < b ? a : b) + (a < b ? b : a)] / l->memory->predicted;
}

/* This cycle's mean products with what is recalled of the cycles before under the weights v; `out` may be the past. */
static void recall(const Learner *l, const real *v, real *now, real *out)
{
    const Shape s = l->shape;
    real b = 0;
    for (int i = 0; i < row_width(s); ++i) {
        for (int j = i; j < row_width(s); ++j) {
            now[at(s, i, j)] = mean_product(l, i, j);
        }
    }
    if (l->clock->past_share > 0) {
        const real new_cost = most(cost(s, now, v), SMALLEST), old_cost = most(cost(s, l->cyclic.past, v), SMALLEST);
        b = RECALL * (new_cost < old_cost ? new_cost / old_cost : old_cost / new_cost);
    }
    for (int k = 0; k < products(s); ++k) {
        out[k] = b > 0 ? (now[k] + b * l->cyclic.past[k]) / (1 + b) : now[k];
    }
}

/* Whether the operator of threshold r, at z when counting began, was moved. */
static int moved(const Cyclic *c, real r, real z) { return c->covered[X_MAX] - r > z || c->covered[X_MIN] + r < z; }

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
               || (zone > middle ? c->covered[Y_MAX] > l->regressors.high[zone]
                                 : c->covered[Y_MIN] < l->regressors.low[zone]);
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
    const Shape s = l->shape;
    const Cyclic *const c = &l->cyclic;
    const int d = l->d;
    real *const data = c->data, *const P = c->P, *const held = c->found;
    real largest = 0, trace = 0, rho;
    memcpy(c->reference, l->in_use, sizeof(real) * (size_t)d);
    for (int j = 0; j < d; ++j) {
        const real diagonal = data[at(s, j + 1, j + 1)];
        largest = most(largest, diagonal);
        trace += diagonal;
    }
    rho = l->settings->proximal * trace / (real)d;
    for (int j = 0; j < d; ++j) {
        const real diagonal = data[at(s, j + 1, j + 1)];
        const int active = reached(l, j) && diagonal > UNDETERMINED * largest;
        const real whole_diagonal = (active ? diagonal : 0) + rho;
        held[j] = active ? 0 : l->in_use[j];
        c->start[j] = active ? 1 : 0;
        c->scale[j] = whole_diagonal > 0 ? 1 / ROOT(whole_diagonal) : 1;
        P[j * d + j] = whole_diagonal > 0 ? 1 : 0;
    }
    for (int i = 0; i < d; ++i) {
        real q = data[at(s, 0, i + 1)];
        for (int j = 0; j < d; ++j) {
            const real p = data[at(s, i + 1, j + 1)];
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
        c->start[j] = most(c->lower[j], l->in_use[j] / c->scale[j]);
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
    memcpy(c->covered, l->memory->span, 4 * sizeof(real));
    if ((c->covered[X_MAX] - c->covered[X_MIN]) / 2 < MIN_EXCITATION) {
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
    const real share = (c->covered[X_MAX] - c->covered[X_MIN]) / 2;
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
    before = most(cost(l->shape, c->data, l->in_use), 0);
    after = most(cost(l->shape, c->data, c->found), 0);
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

static void count(const Learner *l, const Passed *b)
{
    LearnerMemory *const m = l->memory;
    if (m->predicted == 0 && b->good > 0) { /* what the excitation of the operators is judged by later */
        const Block first = block_at(&l->mailbox, l->mailbox.head->consumed);
        for (int i = 0; i < lanes(l->shape); ++i) {
            l->cyclic.start_play[i] = play_step((real)first.x[0], l->regressors.operators.r[i], (real)first.play[i]);
        }
        for (int i = 0; i < creep_lanes(l->shape); ++i) {
            l->cyclic.start_creep[i] = (real)first.creep[i];
        }
    }
    m->predicted += b->good;
    for (int i = 0; i < 4; i += 2) {
        m->span[i] = least(m->span[i], b->span[i]);
        m->span[i + 1] = most(m->span[i + 1], b->span[i + 1]);
    }
    learner_add_rows(l, b->count, 1);
}

int cyclic_block(const Learner *l, const Passed *b)
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
