/* The step and the learner of one actuator as Python calls them: the learner runs at the end of each block, in the
 * same call. See controller.h and learner.h. */
#include "controller.h"
#include "bindings_learner.h"

#define LEARNER ((Learner[]){learner_at(MEMORY(0))})
#define LOOP ((Loop[]){loop_at(MEMORY(0), MEMORY(1))})

/* A learner and the controller of its compensator. */
typedef struct {
    Learner learner;
    Controller controller;
} Loop;

static Loop loop_at(void *learner, void *compensator)
{
    const Learner l = learner_at(learner);
    return (Loop){l, {compensator_at(compensator), l.mailbox}};
}

static void set_up(Arguments *a, void *memory, Shape s, int block, int blocks, int mode)
{
    const Learner l = learner_setup(memory, s, block, blocks, mode);
    const Regressors *const p = &l.regressors;
    const Block first = block_at(&l.mailbox, 0);
    const Cyclic none = {0}, *const c = mode == CYCLIC ? &l.cyclic : &none;
    const Workspace w = workspace_of(&l);
    const Field fields[] = {{"settings", l.settings, sizeof *l.settings / sizeof(real)},
                            {"samples", &l.mailbox.head->samples, 1},
                            {"clock", l.clock, sizeof *l.clock / sizeof(real)},
                            {"memory", l.memory, sizeof *l.memory / sizeof(real)},
                            {"guard", l.mailbox.guard, sizeof(SensorGuard) / sizeof(real)},
                            {"noise_gains", l.mailbox.noise_gains, 2},
                            {"in_use", l.in_use, l.d},
                            {"candidate", l.candidate, l.d},
                            {"gram", l.gram, symmetric_nums(l.d + 1)},
                            {"block_play", first.play, lanes(s)},
                            {"block_creep", first.creep, creep_lanes(s)},
                            REGRESSOR_PARTS(p, s),
                            {"P", mode == CYCLIC ? c->P : w.P, l.d * l.d},
                            {"q", mode == CYCLIC ? c->q : w.q, l.d},
                            {"lower", mode == CYCLIC ? c->lower : w.lb, l.d},
                            {"start", mode == CYCLIC ? c->start : w.start, l.d},
                            {"reference", c->reference, l.d},
                            {"covered", c->covered, SPAN},
                            {"data", c->data, symmetric_nums(l.d + 1)},
                            {"answer", c->answer, l.d},
                            {"start_play", c->start_play, lanes(s)},
                            {"start_creep", c->start_creep, creep_lanes(s)}};
    const size_t of_cycles = 6, all = sizeof fields / sizeof *fields;
    return_fields(a, memory, fields, mode == CYCLIC ? all : all - of_cycles);
}

/* Begin, or continue in other ranges, from these operator states. */
static void begin(const Loop *loop, const double *play, const double *creep, int resets)
{
    controller_begin(&loop->controller, play, creep);
    learner_begin(&loop->learner, 1, resets);
}

/* Samples whose drives can be computed at once: new weights take effect a block after their last sample, new ranges, of
 * a learner that `adapts` them, at once, and integral action needs each output. */
static int64_t quiet(const Loop *loop, int adapts)
{
    const Learner *const l = &loop->learner;
    const MailboxHead *const m = l->mailbox.head;
    int64_t end = l->clock->next_interval;
    if (l->settings->mode == CYCLIC) {
        end = m->samples - m->filled + l->clock->phase_left + (l->clock->phase == RESET ? l->settings->build_lasts : 0)
              + (l->clock->phase == LEARN       ? 0
                 : l->settings->solver == STEPS ? l->settings->learn_lasts
                                                : l->settings->solve_lasts);
        end = (end + m->block - 1) / m->block * m->block;
    }
    if (m->offered != m->answered && *l->mailbox.offer.due > m->samples) {
        end = *l->mailbox.offer.due - m->delay;
    }
    return loop->controller.compensator.settings->gain > 0
               ? 1
               : end - m->samples + (adapts && end > m->samples ? 0 : m->delay);
}

/* Whether what cyclic operation adds to a state of unknown origin is safe. */
static int cycle_sound(const Learner *l)
{
    const ProjectedGradientHead *const steps = l->cyclic.descent.head;
    return l->clock->phase >= RESET && l->clock->phase <= LEARN && steps->kind == DESCENT_KIND && steps->d == l->d
           && steps->bytes == descent_bytes(l->d);
}

/* Restore the state of another learner of the same sizes, or refuse it and change nothing. */
static void restore(Arguments *a, void *memory, void *other)
{
    const LearnerHead *const now = memory, *const then = other;
    if (need_bytes(a, 1, now->shaped.state.bytes) || memcmp(now, then, sizeof *now) != 0) {
        refuse(a, "it is the state of a learner of other sizes");
        return;
    }
    const Learner l = learner_at(memory), saved = learner_at(other);
    const size_t parameters = sizeof(real) * (size_t)(lanes(l.shape) + rate_lanes(l.shape) + 4 * zone_lanes(l.shape));
    if (memcmp(l.settings, saved.settings, sizeof *l.settings) != 0
        || memcmp(l.regressors.operators.r, saved.regressors.operators.r, parameters) != 0) {
        refuse(a, "it is the state of a learner of other settings");
    } else if (!learner_sound(&saved, then->block) || (then->mode == CYCLIC && !cycle_sound(&saved))) {
        refuse(a, "a count, an index or a number in it cannot be");
    } else {
        memcpy(memory, other, (size_t)now->shaped.state.bytes);
    }
}

/* Begin the next block with the states at the end of the one that was learned from. */
static void begin_next(const Loop *loop)
{
    const Learner *const l = &loop->learner;
    const Workspace w = workspace_of(l);
    const Block block = block_in(&l->mailbox, 0);                              /* the only one of Python's ring */
    memcpy(w.play, block.play, sizeof(double) * (size_t)state_nums(l->shape)); /* play, then creep */
    for (int i = 0; i < block.head->count; ++i) {
        advance(l->regressors.operators, l->shape, block.x[i], w.play, w.creep);
    }
    controller_begin_block(&loop->controller, w.play, w.creep);
}

/* Observe a sample, of the present drive, or of the drive *x with which no other one begins the next block, and learn
 * from a full block; the events for Python, which takes the states from the next block. */
static int observe(const Loop *loop, const double *x, double y)
{
    const DriveSettings *const p = loop->controller.compensator.settings;
    const double drive = x ? (*x - p->x_centre) / p->x_scale : loop->controller.compensator.play[0];
    const int full = controller_observe(&loop->controller, drive, y);
    const int events = full ? learner_learn(&loop->learner) & ~TAKE_OVER : 0;
    if (full && (events || x)) {
        begin_next(loop);
    }
    return events;
}

/* Observe if `observes`, then drive; after events Python acts first and then calls again for the drive. */
static PyObject *step(const Loop *loop, double y_ref, double y, int observes)
{
    const int events = observes ? observe(loop, NULL, y) : 0;
    return Py_BuildValue("(di)", events ? 0.0 : controller_drive(&loop->controller, y_ref), events);
}

static void drive(const Loop *loop, int64_t samples, const double *y_ref, double *x)
{
    for (int64_t k = 0; k < samples; ++k) {
        x[k] = k == 0 ? controller_drive(&loop->controller, y_ref[k])
                      : compensator_step(&loop->controller.compensator, y_ref[k], NULL);
    }
}

/* Observe samples from number k on, of these drives, or with references each before its drive, until there are events;
 * the number of samples done. With references, a sample that had events is driven first, without being observed anew.
 */
static int64_t process(const Loop *loop, int64_t samples, const double *y, const double *y_ref, double *x, int64_t k,
                       int64_t *events)
{
    for (int64_t observed = y_ref != NULL && *events; k < samples; ++k, observed = 0) {
        *events = observed ? 0 : observe(loop, y_ref ? NULL : x + k, y[k]);
        if (*events) {
            return k + (y_ref == NULL);
        }
        if (y_ref) {
            x[k] = controller_drive(&loop->controller, y_ref[k]);
        }
    }
    return k;
}

#define SIZED FILTERED ", block#1:10000, blocks#1:10000, mode#0:1"
#define BYTES_AT(i) learner_bytes(FILTERED_AT(i), INT(i + 6), INT(i + 7), INT(i + 8))
#define BINDINGS(F)                                                                                                    \
    F(learner_bytes, SIZED, "size of a learner; mode 0 is continuous, 1 cyclic.", 0, WHOLE_RESULT = BYTES_AT(0))       \
    F(exported_learner_bytes, SIZED ", each#4:8", "the same with a mailbox of numbers of so many bytes each.", 0,      \
      WHOLE_RESULT = BYTES_AT(0) - mailbox_bytes(FILTERED_AT(0), INT(6), INT(7))                                       \
                     + mailbox_size(FILTERED_AT(0), INT(6), INT(7), WHOLE(9)))                                         \
    F(learner_setup, "state@, " SIZED, "make a block a learner; where its parts stand.", NEED_BYTES(0, BYTES_AT(1)),   \
      set_up(&a, MEMORY(0), FILTERED_AT(1), INT(7), INT(8), INT(9)))                                                   \
    F(learner_begin, "state@LEAR, compensator@COM2, play[l], creep[c], resets#0:1",                                    \
      "begin to learn from the weights in use and these states.", 0, begin(LOOP, REALS(2), REALS(3), INT(4)))          \
    F(learner_quiet, "state@LEAR, compensator@COM2, adapts#0:1", "samples whose drives cannot change by learning.", 0, \
      WHOLE_RESULT = quiet(LOOP, INT(2)))                                                                              \
    F(learner_restore, "state@LEAR, other@", "become what another learner was.", 0, restore(&a, MEMORY(0), MEMORY(1))) \
    F(learner_refuse, "state@LEAR", "count a refusal, and begin a cycle anew.", 0, learner_refuse(LEARNER, 0))         \
    F(learner_step, "state@LEAR, compensator@COM2, y_ref, y_measured_before, observes#0:1",                            \
      "observe and drive; (drive, events).", 0, OBJECT_RESULT = step(LOOP, NUMBER(2), NUMBER(3), INT(4)))              \
    F(learner_drive, "state@LEAR, compensator@COM2, y_ref[n], x[n]=", "drives until weights may be due.",              \
      SAMPLES_LAST, drive(LOOP, LENGTH(n), REALS(2), REALS(3)))                                                        \
    F(learner_observe, "state@LEAR, compensator@COM2, y[n], x[n], first#0:n, events[1]q=",                             \
      "learn until there are events; samples done.", LENGTH(n) - WHOLE(4) > 20,                                        \
      WHOLE_RESULT = process(LOOP, LENGTH(n), REALS(2), NULL, REALS(3), WHOLE(4), WHOLES(5)))                          \
    F(learner_replay, "state@LEAR, compensator@COM2, y[n], y_ref[n], x[n]=, first#0:n, events[1]q=",                   \
      "the same, each drive after what is learned; the first only drives if there are events at the start.",           \
      LENGTH(n) - WHOLE(5) > 20,                                                                                       \
      WHOLE_RESULT = process(LOOP, LENGTH(n), REALS(2), REALS(3), REALS(4), WHOLE(5), WHOLES(6)))
MAKE_BINDINGS(learner)
