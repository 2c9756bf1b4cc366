#include "continuous.h"

#define BELIEF ((real)1e-6) /* what the weights in use count where learning begins anew, as a share of a full memory of unit amplitudes */
/* After a fault the sensor is the old one if the RMS error of the weights in use is at most TRUST times what it was before, plus
 * TOLERANCE unit amplitudes. */
#define TRUST ((real)5)
#define TOLERANCE ((real)2e-3)

enum { X_LOW, X_HIGH, Y_LOW, Y_HIGH };

static int64_t checkpoint_bytes(Shape s)
{
    return room_bytes(swept_kept_bytes(unknowns(s))) + (int64_t)sizeof(real) * (padded(row_width(s)) + LANES);
}

int64_t continuous_bytes(Shape s)
{
    const int ld = padded(row_width(s));
    const int64_t vectors = 2 * lanes(s) + 2 * creep_lanes(s) + 4 * zone_lanes(s) + row_stride(s) + LANES + 4 * ld
        + padded(weight_count(s)) + LANES;
    return HEAD_BYTES + room_bytes(sizeof(ContinuousMemory)) + vectors * (int64_t)sizeof(real) + 3 * checkpoint_bytes(s)
        + swept_bytes(unknowns(s));
}

static Checkpoint take_checkpoint(Room *room, Shape s)
{
    Checkpoint k;
    k.swept = room_for(room, (size_t)swept_kept_bytes(unknowns(s)));
    k.in_use = reals(room, 1, padded(row_width(s)));
    k.level = reals(room, 1, LANES);
    return k;
}

Continuous continuous_at(void *memory)
{
    Continuous c;
    Room room = after_head(memory);
    c.head = memory;
    c.shape = SHAPE(c.head);
    c.d = unknowns(c.shape);
    c.ld = padded(row_width(c.shape));
    c.memory = room_for(&room, sizeof *c.memory);
    c.regressors = take_regressors(&room, c.shape);
    c.play = reals(&room, 1, lanes(c.shape));
    c.creep = reals(&room, 1, creep_lanes(c.shape));
    c.row = reals(&room, 1, row_stride(c.shape) + LANES);
    c.in_use = reals(&room, 1, c.ld);
    c.candidate = reals(&room, 1, c.ld);
    c.lower = reals(&room, 1, c.ld);
    c.upper = reals(&room, 1, c.ld);
    c.weights = reals(&room, 1, padded(weight_count(c.shape)));
    c.span = reals(&room, 1, LANES);
    c.noted[0] = take_checkpoint(&room, c.shape);
    c.noted[1] = take_checkpoint(&room, c.shape);
    c.fallback = take_checkpoint(&room, c.shape);
    c.swept = swept_at(room.at);
    return c;
}

static void forget_span(Continuous *c)
{
    c->span[X_LOW] = c->span[Y_LOW] = REAL_INFINITY;
    c->span[X_HIGH] = c->span[Y_HIGH] = -REAL_INFINITY;
}

void continuous_setup(void *memory, Shape shape, int middle, real min_slope, double forgetting, double proximal, int most_exchanges)
{
    const ShapedHead head = {CONTINUOUS_KIND, unknowns(shape), continuous_bytes(shape), shape};
    Continuous c;
    memset(memory, 0, (size_t)head.bytes);
    memcpy(memory, &head, sizeof head);
    c = continuous_at(memory);
    lower_bounds(shape, min_slope, c.lower);
    for (int j = 0; j < c.d; ++j) {
        c.upper[j] = REAL_INFINITY;
    }
    swept_setup(c.swept.head, c.d, c.lower, c.upper, forgetting, 1 - forgetting, proximal);
    c.swept.head->cap = most_exchanges;
    c.memory->middle = middle;
    c.memory->settings.min_slope = min_slope;
    c.in_use[0] = c.candidate[0] = 1;
    guard_forget(&c.memory->guard);
    forget_span(&c);
}

void continuous_enter(Continuous *c, int phase)
{
    ContinuousMemory *const m = c->memory;
    m->counts.phase = phase;
    m->counts.left = m->settings.reset_lasts;
    m->predicted = 0;
    m->probation = m->squares_in_use = m->squares_candidate = 0;
}

void continuous_begin_anew(Continuous *c, real level)
{
    ContinuousMemory *const m = c->memory;
    Swept *const s = &c->swept;
    memset(s->P, 0, (size_t)c->d * (size_t)c->d * sizeof(real));
    for (int j = 0; j < c->d; ++j) { /* P = BELIEF I, q = -BELIEF v */
        s->P[j * c->d + j] = BELIEF;
        s->q[j] = -BELIEF * most(c->lower[j], c->in_use[j + 1]);
    }
    swept_begin(s, s->P, s->q, 0, 0);
    swept_answer(s);
    memcpy(c->candidate, c->in_use, (size_t)c->ld * sizeof(real));
    m->level = level;
    m->established = m->revert = m->noted = m->in_half = 0;
    m->wait = m->has_fallback ? m->settings.half_window : 0;
    m->low = m->low_before = REAL_INFINITY;
    m->high = m->high_before = -REAL_INFINITY;
}

/* Note the present state; the one before the last is forgotten. */
static void note(Continuous *c)
{
    const size_t bytes = (size_t)checkpoint_bytes(c->shape);
    Checkpoint *const here = &c->noted[1];
    memcpy(c->noted[0].swept, c->noted[1].swept, bytes);
    memcpy(here->swept, c->swept.head, (size_t)swept_kept_bytes(c->d));
    memcpy(here->in_use, c->in_use, (size_t)c->ld * sizeof(real));
    *here->level = c->memory->level;
    c->memory->noted += c->memory->noted < 2;
}

/* Go back to a state that the sensor was good at, if there is one. */
static void fall_back(Continuous *c)
{
    ContinuousMemory *const m = c->memory;
    if (m->noted > 0) {
        memcpy(c->fallback.swept, c->noted[2 - m->noted].swept, (size_t)checkpoint_bytes(c->shape));
        m->has_fallback = 1;
        m->noted = 0;
    }
    if (!m->has_fallback) {
        continuous_begin_anew(c, 0);
        return;
    }
    memcpy(c->swept.head, c->fallback.swept, (size_t)swept_kept_bytes(c->d));
    memcpy(c->candidate, c->fallback.in_use, (size_t)c->ld * sizeof(real));
    m->level = *c->fallback.level;
    m->established = m->revert = 1;
}

/* Samples have been good for long enough: is it the sensor that it was before the fault? */
static int end_probation(Continuous *c)
{
    ContinuousMemory *const m = c->memory;
    const real error = m->probation / (real)m->settings.reset_lasts;
    const int other = m->has_fallback && ROOT(error) > TRUST * ROOT(m->level) + TOLERANCE;
    if (other) {
        continuous_begin_anew(c, error);
    } else if (!m->has_fallback) {
        m->level = error;
    }
    continuous_enter(c, LEARN);
    return other ? OTHER_SENSOR : 0;
}

/* Whether the drive of this half window and the one before says enough; takes x into account. */
static int excites(ContinuousMemory *m, real x)
{
    int enough;
    m->low = least(m->low, x);
    m->high = most(m->high, x);
    ++m->in_half;
    enough = most(m->high, m->high_before) - least(m->low, m->low_before) >= 2 * MIN_EXCITATION;
    if (m->in_half >= m->settings.half_window) {
        m->low_before = m->low;
        m->high_before = m->high;
        m->low = m->high = x;
        m->in_half = 0;
    }
    return enough;
}

/* Learn from the row, on which the weights in use have this error. */
static int learn(Continuous *c, real error, real y)
{
    ContinuousMemory *const m = c->memory;
    const real x = c->row[0], other = weighted_sum(c->candidate, c->row, c->ld);
    int status;
    c->span[X_LOW] = least(c->span[X_LOW], x);
    c->span[X_HIGH] = most(c->span[X_HIGH], x);
    c->span[Y_LOW] = least(c->span[Y_LOW], y);
    c->span[Y_HIGH] = most(c->span[Y_HIGH], y);
    m->squares_in_use += error * error;
    m->squares_candidate += other * other;
    ++m->predicted;
    m->wait -= m->wait > 0;
    m->level += m->settings.smoothing * (error * error - m->level);
    status = swept_take(&c->swept, c->row + 1);
    if (status == OK || status == CAPPED) {
        return 0;
    }
    ++m->counts.failures;
    if (swept_recover(&c->swept) == OK) {
        return 0;
    }
    continuous_begin_anew(c, m->level);
    return NO_OPTIMUM;
}

static int put_in_use(Continuous *c)
{
    memcpy(c->in_use, c->candidate, (size_t)c->ld * sizeof(real));
    weights_of(c->shape, (int)c->memory->middle, c->in_use + 1, c->weights);
    return TAKE_OVER;
}

/* Compare the weights in use with the candidate, hand over, and choose the next candidate. */
static int end_interval(Continuous *c)
{
    ContinuousMemory *const m = c->memory;
    int brought = 0;
    if (m->revert) {
        brought = put_in_use(c);
        m->revert = 0;
        m->counts.left = m->settings.reset_lasts;
        m->probation = 0;
    } else if (m->predicted > 0) {
        const int better = m->squares_candidate <= m->squares_in_use; /* NaN compares false */
        if (better && m->excited && m->wait == 0) {
            brought = put_in_use(c);
            ++m->counts.hand_overs;
            brought |= m->established ? 0 : FIRST;
            m->established = 1;
        } else if (!better) {
            ++m->counts.refusals;
        }
        swept_answer(&c->swept);
        memcpy(c->candidate + 1, c->swept.answer, (size_t)c->d * sizeof(real));
    }
    m->squares_in_use = m->squares_candidate = 0;
    m->predicted = 0;
    if (!(brought & FIRST) && m->counts.phase == LEARN && m->counts.sample % m->settings.checkpoint == 0) {
        if (m->established) {
            note(c);
        }
        brought |= LOOK;
    }
    return brought;
}

int continuous_observe(Continuous *c, real x, real y)
{
    ContinuousMemory *const m = c->memory;
    LearningCounts *const n = &m->counts;
    const real unit_x = (x - m->scales.x_centre) / m->scales.x_scale, unit_y = (y - m->scales.y_centre) / m->scales.y_scale;
    const int verdict = guard_judge(&m->guard, unit_x, unit_y), phase = (int)n->phase;
    int brought = 0;
    ++n->verdicts[verdict];
    n->last_verdict = verdict;
    ++n->sample;
    if (verdict == GOOD) {
        real error;
        regressor_row(&c->regressors, c->shape, unit_x, unit_y, c->play, c->creep, c->row);
        c->row[row_width(c->shape)] = unit_x;
        error = weighted_sum(c->in_use, c->row, c->ld);
        if (phase == RESET) {
            m->probation += error * error;
            --n->left;
            brought = n->left <= 0 ? end_probation(c) : 0;
        } else {
            m->excited = excites(m, unit_x);
            brought = m->excited || !m->established ? learn(c, error, unit_y) : 0;
        }
    } else {
        advance(c->regressors.operators, c->shape, unit_x, c->play, c->creep);
        if (verdict != MISSING && phase == RESET) {
            n->left = m->settings.reset_lasts;
            m->probation = 0;
        } else if (verdict != MISSING) {
            ++n->faults;
            forget_span(c);
            fall_back(c);
            continuous_enter(c, RESET);
            brought = SENSOR_FAULT;
        }
    }
    if (n->phase == phase && n->sample % m->settings.interval == 0) { /* an interval that ends with the phase is not looked at */
        brought |= end_interval(c);
    }
    return brought;
}
