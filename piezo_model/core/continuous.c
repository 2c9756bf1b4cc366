/* Continuous learning, in blocks.
 *
 *     reset   the squared errors (5) of the weights in use are summed; nothing is learned
 *     learn   G <- lambda G + (1 - lambda) row row',   row = (Xi, x), sample by sample
 *
 * The candidate is the optimum of G at the last interval. At the end of an interval it replaces the weights in use if
 * it predicted the interval at least as well, and the optimum of the present G becomes the next candidate. Weights are
 * handed over only while the output rises with the input (direction.h) and the drive of the last one to two half
 * windows covers enough of its range. While it covers less, after the first hand-over, learning pauses as well: G would
 * decay and be filled with sensor noise.
 *
 * A sensor fault loses nothing that was learned before it, and keeps nothing learned from a failing sensor:
 *
 * - G and the weights are restored from a checkpoint that is at least one checkpoint interval old, and learning waits
 *   until samples have been good for the length of a reset;
 * - if the weights in use predict these samples about as well as before the fault, learning continues from there;
 * - otherwise the sensor or the actuator has changed: learning begins anew, and new weights are handed over after a
 *   half window without a fault. The checkpoint is kept until then, since the old sensor may come back.
 */
#include "direction.h"
#include "rows.h"

/* Weight of the weights in use when learning begins anew, relative to a full memory of amplitude 1. */
#define BELIEF ((real)1e-6)
/* After a fault the sensor counts as unchanged if the RMS error of the weights in use is at most TRUST times the error
 * before the fault, plus TOLERANCE in normalised units. */
#define TRUST ((real)5)
#define TOLERANCE ((real)2e-3)

void N(learner_begin_anew)(const Learner *l, num which, num level)
{
    LearnerMemory *const m = l->memory;
    const int d = l->d;
    for (int i = 0; i <= d; ++i) { /* G = BELIEF I, its last column -BELIEF v */
        num *const row = l->gram + symmetric_row(d + 1, i);
        for (int j = WIDTH == 1 ? 0 : i; j <= d; ++j) {
            set_where(which, row + j, constant(i == j && i < d ? BELIEF : 0));
        }
        if (i < d) {
            set_where(which, row + d, times(constant(-BELIEF), greatest(l->in_use[i], constant(lower_bound(l, i)))));
        }
    }
    for (int i = 0; i < NUMS(l->shape.zones) + NOISE; ++i) {
        set_where(which, l->pieces + i, constant(0));
    }
    set_where(which, m->recent, constant((real)NAN));
    copy_where(which, l->candidate, l->in_use, d);
    forget_direction(m, which);
    set_where(which, &m->level, level);
    set_where(which, &m->established, constant(0));
    set_where(which, &m->revert, constant(0));
    set_where(which, &m->in_half, constant(0));
    set_where(which, &m->wait, times(m->has_checkpoint, constant((real)l->settings->half_window)));
    span_clear(m->drive, 2, which);
    span_clear(m->drive_before, 2, which);
    span_clear(m->span, SPAN, which);
}

static void clear_errors(LearnerMemory *m, num which)
{
    set_where(which, &m->predicted, constant(0));
    set_where(which, &m->squares_in_use, constant(0));
    set_where(which, &m->squares_candidate, constant(0));
}

/* Reset for a number of samples, or learn for 0. */
static void enter(const Learner *l, num which, real samples)
{
    LearnerMemory *const m = l->memory;
    set_where(which, &m->reset_remaining, constant(samples));
    set_where(which, &m->probation, constant(0));
    clear_errors(m, which);
}

/* Wait for the first end of an interval after a sample. */
static void await_interval(const Learner *l, int64_t sample)
{
    const int64_t interval = l->settings->interval;
    l->clock->next_interval = (sample / interval + 1) * interval;
}

void N(continuous_pause)(const Learner *l)
{
    await_interval(l, l->mailbox.head->samples);
    l->memory->recent[0] = constant((real)NAN);
}

void N(continuous_begin)(const Learner *l, num which, int resets)
{
    await_interval(l, l->mailbox.head->samples);
    set_where(which, &l->memory->has_checkpoint, constant(0));
    enter(l, which, resets ? (real)l->settings->reset_lasts : 0);
    N(learner_begin_anew)(l, which, resets ? constant(0) : l->memory->level);
}

/* Restore the older checkpoint, or begin anew without one. */
static void fall_back(const Learner *l, num which)
{
    LearnerMemory *const m = l->memory;
    const num has_checkpoint = logical_and(which, m->has_checkpoint);
    const int entries = data_nums(l->shape);
    copy_where(logical_and(which, m->pending), l->in_use, l->before, l->d); /* the pending offer will not be taken */
    set_where(which, &m->pending, constant(0));
    copy_where(has_checkpoint, l->gram, l->checkpoint.gram, entries);
    copy_where(has_checkpoint, l->candidate, l->checkpoint.in_use, l->d);
    copy_where(has_checkpoint, &m->level, l->checkpoint.level, 1);
    set_where(has_checkpoint, &m->established, constant(1));
    set_where(has_checkpoint, &m->revert, constant(1));
    copy_where(has_checkpoint, l->next_checkpoint.gram, l->checkpoint.gram, checkpoint_nums(l->shape));
    span_clear(m->span, SPAN, which);
    N(learner_begin_anew)(l, logical_and(which, is_not(has_checkpoint)), constant(0));
}

/* Make a checkpoint of the present state; the one before becomes the older checkpoint, which faults restore. The first
 * one becomes both. */
static void make_checkpoint(const Learner *l, num which)
{
    LearnerMemory *const m = l->memory;
    const num first = logical_and(which, is_not(m->has_checkpoint)), again = logical_and(which, m->has_checkpoint);
    copy_where(again, l->checkpoint.gram, l->next_checkpoint.gram, checkpoint_nums(l->shape));
    copy_where(which, l->next_checkpoint.gram, l->gram, data_nums(l->shape));
    copy_where(which, l->next_checkpoint.in_use, l->in_use, l->d);
    copy_where(which, l->next_checkpoint.level, &m->level, 1);
    copy_where(first, l->checkpoint.gram, l->next_checkpoint.gram, checkpoint_nums(l->shape));
    set_where(which, &m->has_checkpoint, constant(1));
}

/* End the reset after enough good samples; 1 where the sensor is not the one before the fault. */
static num end_probation(const Learner *l, num which)
{
    LearnerMemory *const m = l->memory;
    const num lasted = minus(constant((real)l->settings->reset_lasts), m->reset_remaining);
    const num error = greatest(divided(m->probation, lasted), constant(0));
    /* sqrt(e) > T sqrt(l) + tau  iff  s = e - T^2 l - tau^2 > 0 and s^2 > 4 T^2 tau^2 l */
    const num s = minus(minus_times(error, constant(TRUST * TRUST), m->level), constant(TOLERANCE * TOLERANCE));
    const num beyond = logical_and(
        less(constant(0), s), less(times(constant(4 * TRUST * TRUST * TOLERANCE * TOLERANCE), m->level), times(s, s)));
    const num other = logical_and(which, logical_and(m->has_checkpoint, beyond));
    set_where(logical_and(which, is_not(m->has_checkpoint)), &m->level, error);
    if (any(other)) {
        N(learner_begin_anew)(l, other, error);
    }
    enter(l, which, 0);
    return other;
}

/* 1 where the drive of the current half window and the one before covers enough of its range; adds the block where it
 * `counts`. */
static num excites(const Learner *l, const BlockSummary *b, num counts)
{
    LearnerMemory *const m = l->memory;
    const num low = lowest(b->span[X_LOW], m->drive[0]), high = greatest(b->span[X_HIGH], m->drive[1]);
    const num span = minus(greatest(high, m->drive_before[1]), lowest(low, m->drive_before[0]));
    const num filled = plus(m->in_half, b->good),
              over = logical_and(counts, is_not(less(filled, constant((real)l->settings->half_window))));
    set_where(counts, &m->in_half, where(over, constant(0), filled));
    set_where(counts, &m->drive[0], low);
    set_where(counts, &m->drive[1], high);
    copy_where(over, m->drive_before, m->drive, 2);
    span_clear(m->drive, 2, over);
    return is_not(less(span, constant(2 * MIN_EXCITATION)));
}

/* Learn from the rows of a block. */
static void learn(const Learner *l, const Block *block, const BlockSummary *b, num which)
{
    LearnerMemory *const m = l->memory;
    const num smoothing = lowest(times(constant(l->settings->smoothing), b->good), constant(1));
    const num mean = divided(b->squares_in_use, greatest(b->good, constant(1)));
    set_where(which, &m->level, greatest(plus_times(m->level, smoothing, minus(mean, m->level)), constant(0)));
    set_where(which, &m->squares_in_use, plus(m->squares_in_use, b->squares_in_use));
    set_where(which, &m->squares_candidate, plus(m->squares_candidate, b->squares_candidate));
    set_where(which, &m->predicted, plus(m->predicted, b->good));
    set_where(which, &m->wait, greatest(minus(m->wait, b->good), constant(0)));
    span_widen(m->span, b->span, which);
    add_rows(l, b->count, which);
    N(noise_add)(l, block, which);
}

/* Compute the next candidate, or leave its program to a solver outside; begin anew where it has no optimum. */
static int next_candidate(const Learner *l, num which)
{
    LearnerMemory *const m = l->memory;
    if (SOLVER(l->settings) == ANSWERED) { /* of a single learner only */
        N(learner_program)(l, 0);
        return PROGRAM;
    }
    const num failed = N(learner_optimum)(l, which);
    if (!any(failed)) {
        return 0;
    }
    m->failures = plus(m->failures, failed);
    set_where(failed, &m->has_checkpoint, constant(0)); /* the checkpoint has the same data */
    N(learner_begin_anew)(l, failed, m->level);
    return NO_OPTIMUM;
}

/* Offer the candidate where it predicted at least as well as the weights in use, and compute the next one. */
static int end_interval(const Learner *l, const BlockSummary *b, num looked_at, num excited)
{
    LearnerMemory *const m = l->memory;
    const LearnerSettings *const p = l->settings;
    const int64_t end = b->end / p->interval * p->interval;
    const int checkpoint = end % p->checkpoint == 0;
    const num reverts = logical_and(looked_at, m->revert),
              judged = logical_and(logical_and(looked_at, is_not(reverts)), less(constant(0), m->predicted));
    const num better =
        logical_and(is_finite(m->squares_candidate), is_not(less(m->squares_in_use, m->squares_candidate)));
    const num rises = less(constant(0), m->evidence[DIRECTION]),
              falls = logical_and(judged, less(m->evidence[DIRECTION], constant(0)));
    const num takes = logical_and(logical_and(judged, logical_and(better, rises)),
                                  logical_and(excited, is_not(less(constant(0), m->wait))));
    const num fresh = logical_or(reverts, takes), first = logical_and(takes, is_not(m->established));
    int events = 0;
    if (checkpoint) {
        make_checkpoint(l, logical_and(logical_and(looked_at, is_not(less(constant(0), m->reset_remaining))),
                                       logical_and(m->established, is_not(logical_or(m->pending, m->revert)))));
    }
    if (any(fresh) && N(learner_offer)(l, l->candidate, fresh, reverts, end + l->mailbox.head->delay)) {
        copy_where(fresh, l->before, l->in_use, l->d);
        copy_where(fresh, l->in_use, l->candidate, l->d);
        m->pending = logical_or(m->pending, fresh);
        m->hand_overs = plus(m->hand_overs, takes);
        set_where(takes, &m->established, constant(1));
        set_where(reverts, &m->revert, constant(0));
        enter(l, reverts, (real)p->reset_lasts);
        events = TAKE_OVER | (any(first) ? FIRST : 0);
    }
    m->reversed = plus(m->reversed, falls);
    m->refusals = plus(m->refusals, logical_or(falls, logical_and(judged, is_not(better))));
    if (any(judged)) {
        events |= next_candidate(l, judged);
    }
    clear_errors(m, looked_at);
    const int checks = checkpoint && any(is_not(less(constant(0), m->reset_remaining))) && !(events & FIRST);
    return events | (checks ? CHECK_RANGE : 0);
}

int N(continuous_block)(const Learner *l, const Block *block, const BlockSummary *b)
{
    LearnerMemory *const m = l->memory;
    const num resets = less(constant(0), m->reset_remaining), sound = logical_and(m->learning, is_not(b->fault));
    const num fault = logical_and(m->learning, b->fault), failed = logical_and(fault, is_not(resets));
    const num probed = logical_and(sound, resets), in_phase = logical_and(sound, is_not(resets));
    const num excited = excites(l, b, in_phase);
    const num learns =
        logical_and(logical_and(in_phase, less(constant(0), b->good)), logical_or(excited, is_not(m->established)));
    int events = 0;
    if (any(failed)) {
        m->faults = plus(m->faults, failed);
        fall_back(l, failed);
        events = SENSOR_FAULT;
    }
    enter(l, fault, (real)l->settings->reset_lasts);
    set_where(probed, &m->probation, plus(m->probation, b->squares_in_use));
    set_where(probed, &m->reset_remaining, minus(m->reset_remaining, b->good));
    const num ended = logical_and(probed, is_not(less(constant(0), m->reset_remaining)));
    if (any(ended) && any(end_probation(l, ended))) {
        events |= OTHER_SENSOR;
    }
    if (any(learns)) {
        learn(l, block, b, learns);
    }
    if (b->end >= l->clock->next_interval) { /* an interval that ends together with its phase is not judged */
        await_interval(l, b->end);
        events |= end_interval(l, b, logical_and(m->learning, is_not(logical_or(failed, ended))), excited);
    }
    return events;
}
