/* The step and the learner of one actuator, and the guard of its sensor, as Python calls them: the learner runs at the
 * end of each block, in the same call. See controller.h and learner.h. */
#include "controller.h"
#include "face_model.h"
#include "learner.h"

TAKE_STATE(learner, Learner, LEARNER_KIND)

/* A learner and the controller of its compensator. */
typedef struct {
    Learner learner;
    Controller controller;
} Loop;

static Loop take_loop(Arguments *a)
{
    Loop loop;
    memset(&loop, 0, sizeof loop);
    loop.learner = take_learner(a);
    void *const other = take_state(a, COMPENSATOR_KIND);
    if (good(a)) {
        loop.controller.compensator = compensator_at(other);
        loop.controller.mailbox = loop.learner.mailbox;
        if (memcmp(&loop.learner.shape, &loop.controller.compensator.shape, sizeof(Shape)) != 0) {
            refuse(a, "learner and compensator are of two shapes");
        }
    }
    return loop;
}

static void take_sizes(Arguments *a, Shape *s, int *block, int *blocks, int *way)
{
    *s = take_shape(a);
    *block = (int)take_integer(a, 1, MOST_OPERATORS);
    *blocks = (int)take_integer(a, 1, MOST_OPERATORS);
    *way = (int)take_integer(a, CONTINUOUS, CYCLIC);
}

FACE(learner_bytes)
{
    Shape s;
    int block, blocks, way;
    take_sizes(a, &s, &block, &blocks, &way);
    return finish_integer(a, good(a) ? learner_bytes(s, block, blocks, way) : 0);
}

FACE(exported_learner_bytes)
{
    Shape s;
    int block, blocks, way;
    take_sizes(a, &s, &block, &blocks, &way);
    const int64_t each = take_integer(a, 4, 8);
    return finish_integer(a, good(a) ? learner_bytes(s, block, blocks, way) - mailbox_bytes(s, block, blocks)
                                           + mailbox_size(s, block, blocks, each)
                                     : 0);
}

FACE(learner_setup)
{
    void *const memory = take_state(a, 0);
    Shape s;
    int block, blocks, way;
    take_sizes(a, &s, &block, &blocks, &way);
    need_bytes(a, 0, learner_bytes(s, block, blocks, way));
    if (!good(a)) {
        return finish(a, NULL);
    }
    const Learner l = learner_setup(memory, s, block, blocks, way);
    const Regressors *const p = &l.regressors;
    const Block first = block_at(&l.mailbox, 0);
    const Cyclic none = {0}, *const c = way == CYCLIC ? &l.cyclic : &none;
    const Part parts[] = {{"settings", l.settings, sizeof *l.settings / sizeof(real)},
                          {"delay", &l.mailbox.head->delay, 1},
                          {"samples", &l.mailbox.head->samples, 1},
                          {"clock", l.clock, sizeof *l.clock / sizeof(real)},
                          {"memory", l.memory, sizeof *l.memory / sizeof(real)},
                          {"guard", l.mailbox.guard, sizeof(SensorGuard) / sizeof(real)},
                          {"in_use", l.in_use, l.d},
                          {"candidate", l.candidate, l.d},
                          {"gram", l.gram, symmetric_nums(l.d + 1)},
                          {"block_play", first.play, lanes(s)},
                          {"block_creep", first.creep, creep_lanes(s)},
                          {"r", p->operators.r, lanes(s)},
                          {"a", p->operators.a, s.rates},
                          {"low", p->low, zone_lanes(s)},
                          {"high", p->high, zone_lanes(s)},
                          {"outer_low", p->outer_low, zone_lanes(s)},
                          {"outer_high", p->outer_high, zone_lanes(s)},
                          {"reference", c->reference, l.d},
                          {"covered", c->covered, 4},
                          {"data", c->data, row_width(s) * (row_width(s) + 1) / 2},
                          {"P", c->P, l.d * l.d},
                          {"q", c->q, l.d},
                          {"lower", c->lower, l.d},
                          {"start", c->start, l.d},
                          {"answer", c->answer, l.d},
                          {"start_play", c->start_play, lanes(s)},
                          {"start_creep", c->start_creep, creep_lanes(s)}};
    const size_t of_cycles = 10, all = sizeof parts / sizeof *parts;
    return finish_parts(a, memory, parts, way == CYCLIC ? all : all - of_cycles);
}

/* Begin, or go on in other ranges, from these states of the operators. */
FACE(learner_begin)
{
    Loop loop = take_loop(a);
    const Shape s = loop.learner.shape;
    const double *const play = take_array(a, VECTOR, lanes(s));
    const double *const creep = take_array(a, VECTOR, creep_lanes(s));
    const int resets = (int)take_integer(a, 0, 1);
    if (good(a)) {
        controller_begin(&loop.controller, play, creep);
        learner_begin(&loop.learner, resets);
    }
    return finish_integer(a, 0);
}

FACE(learner_begin_anew)
{
    Learner l = take_learner(a);
    const double level = take_number(a);
    if (good(a)) {
        l.memory->noted = 0;
        learner_begin_anew(&l, 1, level);
    }
    return finish_integer(a, 0);
}

FACE(learner_program)
{
    Learner l = take_learner(a);
    double *const P = take_output(a, l.d, l.d);
    double *const q = take_output(a, VECTOR, l.d);
    double *const lower = take_output(a, VECTOR, l.d);
    if (good(a)) {
        const Pivoting program = workspace_of(&l).program;
        learner_program(&l);
        for (int i = 0; i < l.d; ++i) {
            for (int j = i; j < l.d; ++j) {
                P[i * l.d + j] = P[j * l.d + i] = program.data[symmetric_row(l.d + 1, i) + j];
            }
            q[i] = program.q[i];
            lower[i] = program.lb[i];
        }
    }
    return finish_integer(a, 0);
}

FACE(cyclic_enter)
{
    Learner l = take_learner(a);
    const int phase = (int)take_integer(a, RESET, LEARN);
    if (good(a)) {
        cyclic_enter(&l, phase);
    }
    return finish_integer(a, 0);
}

/* Samples for which the weights in use cannot change, so that their drive can be computed in one go. */
FACE(learner_quiet)
{
    const Learner l = take_learner(a);
    if (!good(a)) {
        return finish(a, NULL);
    }
    const MailboxHead *const m = l.mailbox.head;
    const LearnerSettings *const p = l.settings;
    const LearnerClock *const t = l.clock;
    const int64_t learns = p->solver == STEPS ? p->learn_lasts : p->solve_lasts;
    int64_t end = t->next_interval;
    if (p->way == CYCLIC) {
        end = m->samples + t->phase_left
              + (t->phase == RESET   ? p->build_lasts + learns
                 : t->phase == BUILD ? learns
                                     : 0);
        end = (end + m->block - 1) / m->block * m->block;
    }
    if (m->offered != m->answered && *l.mailbox.offer.due > m->samples) {
        end = *l.mailbox.offer.due - m->delay;
    }
    return finish_integer(a, end + m->delay - m->samples);
}

/* Whether what comes from outside could be followed: sizes, counts and numbers of blocks within their bounds, numbers
 * finite that have to be. */
static int sound(const Learner *l, const LearnerHead *head)
{
    const MailboxHead *const m = l->mailbox.head;
    const LearnerSettings *const p = l->settings;
    const LearnerClock *const t = l->clock;
    const Block block = block_in(&l->mailbox, 0); /* the ring of Python has one */
    const int cyclic = head->way == CYCLIC;
    int fine = m->block == head->block && m->blocks == head->blocks && m->place == 0 && m->delay >= 0 && m->samples >= 0
               && m->filled >= 0 && m->to_go >= 0 && m->filled + m->to_go <= m->block && m->skipped >= 0
               && m->skipped < m->block && m->published == m->consumed && m->offered - m->answered <= 1;
    fine = fine && p->way == head->way && p->solver >= EXACT && p->solver <= ANSWERED && p->middle >= 0
           && p->middle < l->shape.zones && (cyclic || (p->interval > 0 && p->checkpoint > 0)) && t->phase >= RESET
           && t->phase <= LEARN && t->next_interval >= 0;
    for (int i = 0; fine && i < l->d; ++i) {
        fine = isfinite(l->in_use[i]) && isfinite(l->candidate[i]) && isfinite(l->before[i]);
    }
    for (int i = 0; fine && i <= l->d; ++i) {
        for (int j = i; j <= l->d; ++j) {
            const int at = symmetric_row(l->d + 1, i) + j;
            fine = fine && isfinite(l->gram[at])
                   && (cyclic || (isfinite(l->older.gram[at]) && isfinite(l->newer.gram[at])));
        }
    }
    for (int i = 0; fine && i < lanes(l->shape); ++i) {
        fine = isfinite(block.play[i]);
    }
    for (int i = 0; fine && i < creep_lanes(l->shape); ++i) {
        fine = isfinite(block.creep[i]);
    }
    for (int i = 0; fine && i < m->filled; ++i) {
        fine = isfinite(block.x[i]);
    }
    for (int i = 0; fine && i < inverse_nums(l->shape); ++i) {
        fine = isfinite(l->mailbox.offer.inverse[i]);
    }
    if (fine && cyclic) {
        const DescentHead *const d = l->cyclic.descent.head;
        fine = d->kind == DESCENT_KIND && d->d == l->d && d->bytes == descent_bytes(l->d);
    }
    return fine;
}

/* Become what another learner of the same sizes was; nothing is changed where that cannot be. */
FACE(learner_restore)
{
    Learner l = take_learner(a);
    void *const other = take_state(a, LEARNER_KIND);
    if (good(a)) {
        const LearnerHead *const now = (const LearnerHead *)a->views[0].buf, *const then = other;
        if (memcmp(now, then, sizeof *now) != 0 || a->views[1].len < now->shaped.bytes) {
            refuse(a, "it is the state of a learner of other sizes");
        } else {
            const Learner found = learner_at(other);
            const size_t parameters =
                sizeof(real) * (size_t)(lanes(l.shape) + rate_lanes(l.shape) + 4 * zone_lanes(l.shape));
            if (memcmp(l.settings, found.settings, sizeof *l.settings) != 0
                || memcmp(l.regressors.operators.r, found.regressors.operators.r, parameters) != 0) {
                refuse(a, "it is the state of a learner of other settings");
            } else if (!sound(&found, then)) {
                refuse(a, "a count, an index or a number in it cannot be");
            } else {
                memcpy(a->views[0].buf, other, (size_t)now->shaped.bytes);
            }
        }
    }
    return finish_integer(a, 0);
}

CORE_INLINE int observe(const Loop *loop, double x, double y)
{
    return controller_observe(&loop->controller, x, y) ? learner_learn(&loop->learner) & ~TAKE_OVER : 0;
}

/* Observe where `observes`, then the drive for a reference; (drive, what there is to tell). */
FACE(learner_step)
{
    Loop loop = take_loop(a);
    const double y_ref = take_number(a);
    const double y = take_number(a);
    const int observes = (int)take_integer(a, 0, 1);
    int brought = 0;
    if (!good(a)) {
        return finish(a, NULL);
    }
    if (observes) {
        brought = observe(&loop, loop.controller.compensator.play[0], y);
    }
    if (brought) { /* Python's part comes before the drive */
        return finish(a, Py_BuildValue("(dn)", 0.0, (Py_ssize_t)brought));
    }
    const double x = controller_drive(&loop.controller, y_ref);
    return finish(a, Py_BuildValue("(dn)", x, (Py_ssize_t)0));
}

/* Drives for references until the next block in which weights may be due. */
FACE(learner_drive)
{
    Loop loop = take_loop(a);
    const double *const y_ref = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    double *const x = take_output(a, VECTOR, samples);
    if (good(a) && samples > 0) {
        begin_long_if(a, samples > 100);
        x[0] = controller_drive(&loop.controller, y_ref[0]);
        for (Py_ssize_t k = 1; k < samples; ++k) {
            x[k] = compensator_step(&loop.controller.compensator, y_ref[k], NULL);
        }
    }
    return finish_integer(a, 0);
}

/* Observe drives and outputs from number `first` on, up to where there is something to tell; (samples done, what it
 * is). */
FACE(learner_observe)
{
    Loop loop = take_loop(a);
    const Learner *const l = &loop.learner;
    const Shape s = l->shape;
    const double *const y = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const x = take_array(a, VECTOR, samples);
    Py_ssize_t k = (Py_ssize_t)take_integer(a, 0, samples);
    int brought = 0;
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, samples - k > 20);
    const DriveSettings *const p = loop.controller.compensator.settings;
    const Block block = block_at(&l->mailbox, l->mailbox.head->published); /* the ring of Python has one */
    memcpy(l->seen_play, block.play, sizeof(double) * (size_t)lanes(s));
    memcpy(l->seen_creep, block.creep, sizeof(double) * (size_t)creep_lanes(s));
    for (int i = 0; i < l->mailbox.head->filled; ++i) {
        advance(l->regressors.operators, s, block.x[i], l->seen_play, l->seen_creep);
    }
    for (; k < samples && brought == 0; ++k) {
        const double unit = (x[k] - p->x_centre) / p->x_scale;
        advance(l->regressors.operators, s, unit, l->seen_play, l->seen_creep);
        if (controller_observe(&loop.controller, unit, y[k])) {
            brought = learner_learn(l) & ~TAKE_OVER;
            controller_begin_block(&loop.controller, l->seen_play, l->seen_creep);
        }
    }
    end_long(a);
    return finish(a, Py_BuildValue("(nn)", k, (Py_ssize_t)brought));
}

/* Drive for each reference and observe the output that the drive produced; as learner_observe. */
FACE(learner_replay)
{
    Loop loop = take_loop(a);
    const double *const y = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const y_ref = take_array(a, VECTOR, samples);
    double *const x = take_output(a, VECTOR, samples);
    Py_ssize_t k = (Py_ssize_t)take_integer(a, 0, samples);
    int brought = 0;
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, samples - k > 20);
    for (; k < samples && brought == 0; ++k) {
        x[k] = controller_drive(&loop.controller, y_ref[k]);
        brought = observe(&loop, loop.controller.compensator.play[0], y[k]);
    }
    end_long(a);
    return finish(a, Py_BuildValue("(nn)", k, (Py_ssize_t)brought));
}

FACE(guard_judge)
{
    double *const memory = take_output(a, VECTOR, sizeof(SensorGuard) / sizeof(real));
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const y = take_array(a, VECTOR, samples);
    int64_t *const verdicts = take_integers(a, samples);
    SensorGuard guard;
    if (good(a)) {
        memcpy(&guard, memory, sizeof guard);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            const SensorGuard before = guard;
            num fault;
            guard_judge(&guard, x[k], y[k], &fault);
            verdicts[k] = guard.verdicts[MISSING] > before.verdicts[MISSING]   ? MISSING
                          : guard.verdicts[REFUSED] > before.verdicts[REFUSED] ? REFUSED
                          : guard.verdicts[JUMPED] > before.verdicts[JUMPED]   ? JUMPED
                                                                               : GOOD;
        }
        memcpy(memory, &guard, sizeof guard);
    }
    return finish_integer(a, 0);
}
