#include "cyclic.h"

#define RECALL ((real)0.3)         /* part that the cycles before have in a problem, where their data agree with the new ones */
#define NARROW ((real)0.8)
#define SHRINKING ((real)0.9)
#define SMALLEST ((real)1e-30)     /* costs below are those of rounding */
#define UNDETERMINED ((real)1e-11) /* share of the largest diagonal entry of P below which rounding decides and not the data */

static int triangle(Shape s) { return row_width(s) * (row_width(s) + 1) / 2; }

int64_t cyclic_bytes(Shape s)
{
    const int d = unknowns(s), ld = padded(d);
    const int64_t vectors = 8 * ld + padded(weight_count(s)) + LANES + 2 * padded(triangle(s)) + padded(d * d);
    return HEAD_BYTES + room_bytes(sizeof(CyclicMemory)) + vectors * (int64_t)sizeof(real)
        + room_bytes(basis_bytes(s)) + descent_bytes(d);
}

Cyclic cyclic_at(void *memory)
{
    Cyclic c;
    Room room = after_head(memory);
    c.head = memory;
    c.shape = SHAPE(c.head);
    c.d = unknowns(c.shape);
    c.ld = padded(c.d);
    c.memory = room_for(&room, sizeof *c.memory);
    c.in_use = reals(&room, 1, c.ld);
    c.reference = reals(&room, 1, c.ld);
    c.found = reals(&room, 1, c.ld);
    c.q = reals(&room, 1, c.ld);
    c.lower = reals(&room, 1, c.ld);
    c.upper = reals(&room, 1, c.ld);
    c.start = reals(&room, 1, c.ld);
    c.scale = reals(&room, 1, c.ld);
    c.weights = reals(&room, 1, padded(weight_count(c.shape)));
    c.covered = reals(&room, 1, LANES);
    c.data = reals(&room, 1, padded(triangle(c.shape)));
    c.past = reals(&room, 1, padded(triangle(c.shape)));
    c.P = reals(&room, 1, padded(c.d * c.d));
    c.basis = basis_at(room.at);
    c.descent = descent_at(room.at + room_bytes(basis_bytes(c.shape)));
    c.answer = c.descent.answer;
    return c;
}

void cyclic_setup(void *memory, Shape shape, int middle)
{
    const ShapedHead head = {CYCLIC_KIND, unknowns(shape), cyclic_bytes(shape), shape};
    Cyclic c;
    memset(memory, 0, (size_t)head.bytes);
    memcpy(memory, &head, sizeof head);
    c = cyclic_at(memory);
    basis_setup(c.basis.head, shape, 1);
    for (int j = 0; j < c.ld; ++j) {
        c.upper[j] = REAL_INFINITY;
    }
    descent_setup(c.descent.head, c.d, c.lower, c.upper);
    c.memory->middle = middle;
    guard_forget(&c.memory->guard);
}

void cyclic_enter(Cyclic *c, int phase)
{
    const CyclicSettings *const s = &c->memory->settings;
    c->memory->counts.phase = phase;
    c->memory->counts.left = phase == RESET ? s->reset_lasts : phase == BUILD ? s->build_lasts : s->learn_lasts;
    if (phase == RESET) {
        basis_clear(&c->basis);
    }
}

/* Where entry (i, j) of the products is in their triangle. */
static int at(Shape s, int i, int j)
{
    const int low = i < j ? i : j, high = i < j ? j : i;
    return low * row_width(s) - low * (low - 1) / 2 + high - low;
}

real cyclic_cost(Shape s, const real *data, const real *v)
{
    real cost = data[at(s, 0, 0)] / 2;
    for (int i = 0; i < unknowns(s); ++i) {
        real gradient = data[at(s, 0, i + 1)];
        for (int j = 0; j < unknowns(s); ++j) {
            gradient += data[at(s, i + 1, j + 1)] * v[j] / 2;
        }
        cost += v[i] * gradient;
    }
    return cost;
}

/* Make the Gram matrix of this cycle its mean products. */
static void take_means(Cyclic *c)
{
    const Shape s = c->shape;
    basis_gather(&c->basis);
    for (int i = 0; i < row_width(s); ++i) {
        for (int j = i; j < row_width(s); ++j) { /* in place, since nothing moves to where something is still to be read */
            c->basis.gram[at(s, i, j)] = c->basis.gram[i * row_stride(s) + j] / (real)c->basis.head->samples;
        }
    }
}

/* This cycle's mean products with what is recalled of the cycles before under the weights v. */
static void recall(const Cyclic *c, const real *v, real *out)
{
    const real *const now = c->basis.gram, *const past = c->past;
    real b = 0;
    if (c->memory->past_share > 0) {
        const real new_cost = most(cyclic_cost(c->shape, now, v), SMALLEST), old_cost = most(cyclic_cost(c->shape, past, v), SMALLEST);
        b = RECALL * (new_cost < old_cost ? new_cost / old_cost : old_cost / new_cost);
    }
    for (int k = 0; k < triangle(c->shape); ++k) {
        out[k] = b > 0 ? (now[k] + b * past[k]) / (1 + b) : now[k];
    }
}

/* Whether the operator of threshold r, at z when counting began, was moved. */
static int moved(const Cyclic *c, real r, real z) { return c->covered[X_MAX] - r > z || c->covered[X_MIN] + r < z; }

/* Whether the data reached the threshold of unknown j; the others stay where they are. */
static int reached(const Cyclic *c, int j)
{
    const Shape s = c->shape;
    const Basis *const b = &c->basis;
    const real *const r = b->regressors.operators.r;
    const int zone = j - s.n, first = zone - s.zones, middle = (int)c->memory->middle;
    if (zone < 0) {
        return moved(c, r[j + 1], b->start_play[j + 1]);
    }
    if (first < 0) {
        return zone == middle || (zone > middle ? c->covered[Y_MAX] > b->regressors.high[zone] : c->covered[Y_MIN] < b->regressors.low[zone]);
    }
    for (int k = first; first < creep_weights(s) && k < creep_lanes(s); k += lanes(s)) {
        if (moved(c, r[first], b->start_creep[k])) {
            return 1;
        }
    }
    return first == creep_weights(s); /* the constant */
}

/* The program of the data, its variables scaled to unit diagonal, with a proximal term rho |v - v_in_use|^2 / 2. An operator that
 * stood still has a constant column, which a constant or another such column could take over; so the data act on its unknown no
 * more, and the proximal term keeps it where it was. */
static void make_program(Cyclic *c)
{
    const Shape s = c->shape;
    const int d = c->d;
    real *const data = c->data, *const P = c->P, *const held = c->found;
    real largest = 0, trace = 0, rho;
    memcpy(c->reference, c->in_use, (size_t)c->ld * sizeof(real));
    for (int j = 0; j < d; ++j) {
        const real diagonal = data[at(s, j + 1, j + 1)];
        largest = most(largest, diagonal);
        trace += diagonal;
    }
    rho = c->memory->settings.proximal * trace / (real)d;
    lower_bounds(s, c->memory->settings.min_slope, c->lower);
    for (int j = 0; j < d; ++j) {
        const real diagonal = data[at(s, j + 1, j + 1)];
        const int active = reached(c, j) && diagonal > UNDETERMINED * largest;
        const real whole_diagonal = (active ? diagonal : 0) + rho;
        held[j] = active ? 0 : c->in_use[j];
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
        c->q[i] = c->scale[i] * (c->start[i] * q - rho * c->in_use[i]);
    }
    for (int j = 0; j < d; ++j) {
        c->lower[j] /= c->scale[j];
        c->start[j] = most(c->lower[j], c->in_use[j] / c->scale[j]);
        c->answer[j] = (real)NAN;
    }
}

/* Put the recursion at the start; whether the program can be solved. */
static int begin_steps(Cyclic *c)
{
    if (descent_setup(c->descent.head, c->d, c->lower, c->upper) != OK
        || descent_take(&c->descent, c->P, c->q, c->memory->settings.step_ratio, 0) != OK) {
        return 0;
    }
    descent_start(&c->descent, c->start);
    return 1;
}

static int refuse(Cyclic *c, int why)
{
    ++c->memory->counts.refusals;
    cyclic_enter(c, RESET);
    return why;
}

static int end_of_build(Cyclic *c)
{
    CyclicMemory *const m = c->memory;
    m->learning_since = m->counts.sample;
    memcpy(c->covered, c->basis.span, LANES * sizeof(real));
    if ((c->covered[X_MAX] - c->covered[X_MIN]) / 2 < MIN_EXCITATION) {
        return refuse(c, UNEXCITED);
    }
    take_means(c);
    recall(c, c->in_use, c->data);
    make_program(c);
    cyclic_enter(c, LEARN);
    return !m->settings.steps || begin_steps(c) ? PROGRAM : refuse(c, NOT_A_NUMBER);
}

/* Take the answer over if it passes. */
static int hand_over(Cyclic *c)
{
    CyclicMemory *const m = c->memory;
    const real share = (c->covered[X_MAX] - c->covered[X_MIN]) / 2;
    real total = 0, before, after;
    if (m->settings.steps) {
        descent_answer(&c->descent);
    }
    for (int j = 0; j < c->d; ++j) {
        const real z = c->answer[j] < c->lower[j] ? c->lower[j] : c->answer[j];
        c->found[j] = z * c->scale[j];
        total += c->found[j] - c->found[j];
    }
    if (!(total == 0)) {
        return refuse(c, NOT_A_NUMBER);
    }
    before = most(cyclic_cost(c->shape, c->data, c->in_use), 0);
    after = most(cyclic_cost(c->shape, c->data, c->found), 0);
    m->error_in_use = ROOT(2 * before);
    m->error_found = ROOT(2 * after);
    if (!(after <= before)) {
        return refuse(c, WORSE);
    }
    memcpy(c->in_use, c->found, (size_t)c->ld * sizeof(real));
    weights_of(c->shape, (int)m->middle, c->found, c->weights);
    ++m->counts.hand_overs;
    if (share < NARROW * m->past_share) {
        m->past_share *= SHRINKING;
    } else {
        recall(c, c->found, c->past);
        m->past_share = share;
    }
    cyclic_enter(c, RESET);
    return TAKE_OVER;
}

/* What the end of a phase brings. */
static int leave(Cyclic *c)
{
    switch (c->memory->counts.phase) {
    case RESET:
        cyclic_enter(c, BUILD);
        return 0;
    case BUILD:
        return end_of_build(c);
    default:
        return hand_over(c) | CYCLE_OVER;
    }
}

int cyclic_observe(Cyclic *c, real x, real y)
{
    CyclicMemory *const m = c->memory;
    LearningCounts *const n = &m->counts;
    const real unit_x = (x - m->scales.x_centre) / m->scales.x_scale, unit_y = (y - m->scales.y_centre) / m->scales.y_scale;
    const int verdict = guard_judge(&m->guard, unit_x, unit_y), phase = (int)n->phase;
    ++n->verdicts[verdict];
    n->last_verdict = verdict;
    ++n->sample;
    if (phase == BUILD && verdict == GOOD) {
        basis_count(&c->basis, unit_x, unit_y);
    } else {
        advance(c->basis.regressors.operators, c->shape, unit_x, c->basis.play, c->basis.creep);
    }
    if (phase == LEARN) {
        if (m->settings.steps) {
            projected_steps(&c->descent, 1, -1);
        }
        --n->left;
    } else if (verdict == GOOD) {
        --n->left;
    } else if (verdict != MISSING && phase == RESET) {
        n->left = m->settings.reset_lasts;
    } else if (verdict != MISSING) {
        ++n->faults;
        cyclic_enter(c, RESET);
        return SENSOR_FAULT;
    }
    return n->left <= 0 ? leave(c) : 0;
}
