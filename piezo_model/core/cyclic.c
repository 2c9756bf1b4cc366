/* Cyclic operation, a synchronous Moore machine:   reset -> build -> learn -> reset, with the new weights.
 *
 *     reset    only the operator states advance                          ends after a number of good samples in a row
 *     build    good samples are added to the Gram matrix                 ends after a number of good samples, when the
 *                                                                        direction of the output is known (direction.h)
 *     learn    one step w <- Proj(w - eta (P w + q)) for each sample,    ends after a number of samples
 *              or waiting for the answer of another solver
 *
 * A phase ends with the block in which its count is reached. The operator states follow the actuator in every phase;
 * reset clears P, q and c. A sensor fault leads to reset.
 *
 * Earlier data have a share in new weights. With the mean cost V of this cycle's data, V_p of earlier cycles, and the
 * weights w in use, the cost that is minimised, and the one that is kept as the next V_p, is
 *
 *     (V + b V_p) / (1 + b),   b = RECALL min(V(w) / V_p(w), V_p(w) / V(w))
 *
 * with the w before learning in the first case, and after learning in the second. A cycle over other amplitudes
 * therefore does not undo the last one, while contradicting data (a re-zeroed sensor, a wild reference) are forgotten
 * at once. A cycle whose drive covers less than NARROW of the range of V_p is not kept, since small movements hardly
 * excite most weights; each such cycle takes a tenth off the range of V_p.
 *
 * New weights are handed over if the drive of the building phase covered at least MIN_EXCITATION of its range, the
 * output rises with the input, and they are finite and explain their data no worse than the weights in use, which a
 * failing solver could violate. Weights that the drive did not reach stay, since the reference of the problem are the
 * weights in use.
 *
 * Source: the paper's Fig. 1 and equations (3) to (7).
 */
#include "rows.h"

/* Share of earlier cycles in a problem if their data agree with the new ones. */
#define RECALL ((real)0.3)
/* Smallest share of the range of V_p that a cycle must cover to be kept. */
#define NARROW ((real)0.8)
/* Factor on the range of V_p for each cycle that is not kept. */
#define SHRINKING ((real)0.9)
/* Smallest cost that differs from rounding errors. */
#define SMALLEST ((real)1e-30)
/* Share of the largest diagonal entry of P below which an entry is rounding. */
#define UNDETERMINED ((real)1e-11)

int64_t cyclic_bytes(Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    const int64_t numbers =
        7 * ld + lanes(s) + creep_lanes(s) + LANES + (int64_t)2 * symmetric_nums(d + 1) + padded(d * d);
    return numbers * (int64_t)sizeof(real) + arena_bytes(descent_bytes(d));
}

Cyclic cyclic_at(Arena *arena, Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    Cyclic c;
    const ArenaField fields[] = {{&c.reference, ld},
                                 {&c.learned, ld},
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
    LAY_OUT(arena, fields);
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
    if (l->clock->past_span > 0) {
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

/* Whether the data reached the threshold of unknown j; unreached unknowns keep their values. */
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

/* The program of the data with the proximal term rho |v - v_in_use|^2 / 2, in variables of unit diagonal. The column of
 * an operator that did not move is constant and could be traded against the constant term or another such column; its
 * unknown is therefore excluded from the data's cost, and the proximal term holds it. */
static void make_program(const Learner *l)
{
    const Cyclic *const c = &l->cyclic;
    const int d = l->d;
    real *const data = c->data, *const P = c->P, *const fixed = c->learned;
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
        fixed[j] = active ? 0 : l->in_use[j];
        c->start[j] = active ? 1 : 0;
        c->scale[j] = whole_diagonal > 0 ? 1 / ROOT(whole_diagonal) : 1;
        P[j * d + j] = whole_diagonal > 0 ? 1 : 0;
    }
    for (int i = 0; i < d; ++i) {
        real q = data[at(d, i, d)];
        for (int j = 0; j < d; ++j) {
            const real p = data[at(d, i, j)];
            q += p * fixed[j];
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

/* Set up the recursion; whether the program can be solved. */
static int begin_steps(const Learner *l)
{
    const Cyclic *const c = &l->cyclic;
    if (descent_setup(c->descent.head, l->d, c->lower, c->upper) != OK
        || descent_set_data(&c->descent, c->P, c->q, l->settings->step_ratio, 0) != OK) {
        return 0;
    }
    descent_start(&c->descent, c->start);
    return 1;
}

int learner_refuse(const Learner *l, int why)
{
    l->memory->refusals += 1;
    if (MODE(l->settings) == CYCLIC) {
        cyclic_enter(l, RESET);
    }
    return why;
}

static int end_of_build(const Learner *l, int64_t now)
{
    const Cyclic *const c = &l->cyclic;
    l->clock->learning_since = now;
    memcpy(c->covered, l->memory->span, SPAN * sizeof(real));
    if ((c->covered[X_HIGH] - c->covered[X_LOW]) / 2 < MIN_EXCITATION) {
        return learner_refuse(l, UNEXCITED);
    }
    if (l->memory->evidence[DIRECTION] == 0) {
        l->clock->phase_left = 1; /* build on until the data tell the direction of the output */
        return 0;
    }
    if (l->memory->evidence[DIRECTION] < 0) {
        l->memory->reversed += 1;
        return learner_refuse(l, 0);
    }
    recall(l, l->in_use, c->data, c->data);
    make_program(l);
    cyclic_enter(l, LEARN);
    return SOLVER(l->settings) != STEPS || begin_steps(l) ? PROGRAM : learner_refuse(l, NOT_A_NUMBER);
}

/* Check the answer and offer it. */
static int hand_over(const Learner *l, int64_t now)
{
    const Cyclic *const c = &l->cyclic;
    LearnerClock *const clock = l->clock;
    const real span_share = (c->covered[X_HIGH] - c->covered[X_LOW]) / 2;
    if (SOLVER(l->settings) == STEPS) {
        descent_answer(&c->descent);
    }
    for (int j = 0; j < l->d; ++j) {
        c->learned[j] = greatest(c->lower[j], c->answer[j]) * c->scale[j]; /* NaN stays */
    }
    if (!are_finite(c->learned, l->d)) {
        return learner_refuse(l, NOT_A_NUMBER);
    }
    const real before = greatest(0, cost(l->d, c->data, l->in_use));
    const real after = greatest(0, cost(l->d, c->data, c->learned));
    clock->error_in_use = ROOT(2 * before);
    clock->error_found = ROOT(2 * after);
    if (!(after <= before)) {
        return learner_refuse(l, WORSE);
    }
    if (!learner_offer(l, c->learned, 1, 1, now + l->mailbox.head->delay)) {
        return 0; /* the last offer has not been answered: try again after the next block */
    }
    memcpy(l->in_use, c->learned, sizeof(real) * (size_t)l->d);
    l->memory->hand_overs += 1;
    if (span_share < NARROW * clock->past_span) {
        clock->past_span *= SHRINKING;
    } else {
        recall(l, c->learned, c->data, c->past);
        clock->past_span = span_share;
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
    add_rows(l, b->count, 1);
}

int cyclic_block(const Learner *l, const BlockSummary *b)
{
    LearnerClock *const clock = l->clock;
    if (clock->phase == LEARN) {
        if (SOLVER(l->settings) == STEPS) {
            projected_steps(&l->cyclic.descent, b->count, -1);
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
