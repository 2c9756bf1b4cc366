/* Both learners and the guard of the sensor as Python calls them; see cyclic.h, continuous.h and sensor_guard.h. */
#include "compensator.h"
#include "continuous.h"
#include "cyclic.h"
#include "face_model.h"

#define COUNTS(n) \
    {"phase", &(n)->phase, 1}, {"left", &(n)->left, 1}, {"sample", &(n)->sample, 1}, {"hand_overs", &(n)->hand_overs, 1}, \
    {"refusals", &(n)->refusals, 1}, {"faults", &(n)->faults, 1}, {"failures", &(n)->failures, 1}, {"verdicts", (n)->verdicts, 4}
#define REGRESSORS(p, s) \
    {"r", (p).operators.r, lanes(s)}, {"a", (p).operators.a, creep_lanes(s)}, {"low", (p).low, zone_lanes(s)}, \
    {"high", (p).high, zone_lanes(s)}, {"outer_low", (p).outer_low, zone_lanes(s)}, {"outer_high", (p).outer_high, zone_lanes(s)}

static void *take_learner(Arguments *a, int32_t kind, Compensator *compensator)
{
    void *const learner = take_state(a, kind), *const other = take_state(a, COMPENSATOR_KIND);
    if (!good(a)) {
        return NULL;
    }
    *compensator = compensator_at(other);
    if (memcmp(&((const ShapedHead *)learner)->shape, &compensator->head->shape, sizeof(Shape)) != 0) {
        refuse(a, "learner and compensator are of two shapes");
    }
    return learner;
}

/* Any of the two learners. */
typedef struct {
    Cyclic *cyclic;
    Continuous *continuous;
} Learner;

CORE_INLINE int observe(Learner l, Compensator *compensator, double x, double y)
{
    const int brought = l.cyclic != NULL ? cyclic_observe(l.cyclic, x, y) : continuous_observe(l.continuous, x, y);
    const LearningCounts *const counts = l.cyclic != NULL ? &l.cyclic->memory->counts : &l.continuous->memory->counts;
    if (brought & TAKE_OVER) {
        compensator_hand_over(compensator, l.cyclic != NULL ? l.cyclic->weights : l.continuous->weights);
    }
    if (counts->last_verdict == GOOD) {
        compensator_correct(compensator, y);
    }
    return brought & ~TAKE_OVER;
}

/* From sample number `first` on, up to what somebody has to be told; (samples done, what it is). What was driven is given as x, or the references, which are then driven here. */
static PyObject *learn(Arguments *a, Learner l, Compensator *compensator, int driving)
{
    const double *const y = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const x = take_array(a, VECTOR, samples), *const y_ref = driving ? x : NULL;
    double *const driven = driving ? take_output(a, VECTOR, samples) : NULL;
    Py_ssize_t k = (Py_ssize_t)take_integer(a, 0, samples);
    int brought = 0;
    if (!good(a)) {
        return finish(a, NULL);
    }
    begin_long_if(a, samples - k > 20);
    for (; k < samples && brought == 0; ++k) {
        if (driving) {
            driven[k] = compensator_step(compensator, y_ref[k]);
        }
        brought = observe(l, compensator, driving ? driven[k] : x[k], y[k]);
    }
    end_long(a);
    return finish(a, Py_BuildValue("(nn)", k, (Py_ssize_t)brought));
}

static PyObject *learn_cyclic(Arguments *a, int driving)
{
    Compensator compensator;
    Cyclic c;
    void *const memory = take_learner(a, CYCLIC_KIND, &compensator);
    if (good(a)) {
        c = cyclic_at(memory);
    }
    return learn(a, (Learner){&c, NULL}, &compensator, driving);
}

static PyObject *learn_continuous(Arguments *a, int driving)
{
    Compensator compensator;
    Continuous c;
    void *const memory = take_learner(a, CONTINUOUS_KIND, &compensator);
    if (good(a)) {
        c = continuous_at(memory);
    }
    return learn(a, (Learner){NULL, &c}, &compensator, driving);
}

FACE(cyclic_observe) { return learn_cyclic(a, 0); }
FACE(cyclic_drive) { return learn_cyclic(a, 1); }
FACE(continuous_observe) { return learn_continuous(a, 0); }
FACE(continuous_drive) { return learn_continuous(a, 1); }

TAKE_STATE(cyclic, Cyclic, CYCLIC_KIND)
TAKE_STATE(continuous, Continuous, CONTINUOUS_KIND)

FACE(cyclic_bytes) { return size_for(cyclic_bytes, a); }

FACE(cyclic_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    const int middle = (int)take_integer(a, 0, s.zones - 1);
    need_bytes(a, 0, cyclic_bytes(s));
    if (!good(a)) {
        return finish(a, NULL);
    }
    cyclic_setup(memory, s, middle);
    const Cyclic c = cyclic_at(memory);
    CyclicMemory *const m = c.memory;
    const Part parts[] = {
        COUNTS(&m->counts), REGRESSORS(c.basis.regressors, s), {"reset_lasts", &m->settings.reset_lasts, 1},
        {"build_lasts", &m->settings.build_lasts, 1}, {"learn_lasts", &m->settings.learn_lasts, 1}, {"steps", &m->settings.steps, 1},
        {"proximal", &m->settings.proximal, 1}, {"min_slope", &m->settings.min_slope, 1}, {"step_ratio", &m->settings.step_ratio, 1},
        {"scales", &m->scales, 4}, {"guard", &m->guard, 5}, {"learning_since", &m->learning_since, 1},
        {"error_in_use", &m->error_in_use, 1}, {"error_found", &m->error_found, 1}, {"past_share", &m->past_share, 1},
        {"in_use", c.in_use, c.d}, {"reference", c.reference, c.d}, {"covered", c.covered, 4}, {"data", c.data, row_width(s) * (row_width(s) + 1) / 2},
        {"P", c.P, c.d * c.d}, {"q", c.q, c.d}, {"lower", c.lower, c.d}, {"start", c.start, c.d}, {"answer", c.answer, c.d},
        {"play", c.basis.play, lanes(s)}, {"creep", c.basis.creep, creep_lanes(s)}, {"start_play", c.basis.start_play, lanes(s)},
        {"start_creep", c.basis.start_creep, creep_lanes(s)}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

FACE(cyclic_enter)
{
    Cyclic c = take_cyclic(a);
    const int phase = (int)take_integer(a, RESET, LEARN);
    if (good(a)) {
        cyclic_enter(&c, phase);
    }
    return finish_integer(a, 0);
}

FACE(continuous_bytes) { return size_for(continuous_bytes, a); }

FACE(continuous_setup)
{
    void *const memory = take_state(a, 0);
    const Shape s = take_shape(a);
    const int middle = (int)take_integer(a, 0, s.zones - 1);
    const double min_slope = take_number(a);
    const double forgetting = take_number(a);
    const double proximal = take_number(a);
    const int most_exchanges = (int)take_integer(a, 0, INT32_MAX);
    need_bytes(a, 0, continuous_bytes(s));
    if (!good(a)) {
        return finish(a, NULL);
    }
    continuous_setup(memory, s, middle, min_slope, forgetting, proximal, most_exchanges);
    const Continuous c = continuous_at(memory);
    ContinuousMemory *const m = c.memory;
    const Part parts[] = {
        COUNTS(&m->counts), REGRESSORS(c.regressors, s), {"reset_lasts", &m->settings.reset_lasts, 1},
        {"interval", &m->settings.interval, 1}, {"checkpoint", &m->settings.checkpoint, 1},
        {"half_window", &m->settings.half_window, 1}, {"smoothing", &m->settings.smoothing, 1}, {"scales", &m->scales, 4},
        {"guard", &m->guard, 5}, {"revert", &m->revert, 1}, {"has_fallback", &m->has_fallback, 1}, {"level", &m->level, 1},
        {"in_use", c.in_use + 1, c.d}, {"candidate", c.candidate + 1, c.d}, {"span", c.span, 4}, {"play", c.play, lanes(s)},
        {"creep", c.creep, creep_lanes(s)}};
    return finish_parts(a, memory, parts, sizeof parts / sizeof *parts);
}

FACE(continuous_begin_anew)
{
    Continuous c = take_continuous(a);
    const double level = take_number(a);
    if (good(a)) {
        continuous_begin_anew(&c, level);
    }
    return finish_integer(a, 0);
}

FACE(guard_judge)
{
    SensorGuard guard;
    double *const memory = take_output(a, VECTOR, sizeof guard / sizeof(real));
    const double *const x = take_array(a, VECTOR, ANY_LENGTH);
    const Py_ssize_t samples = taken_length(a);
    const double *const y = take_array(a, VECTOR, samples);
    int64_t *const verdicts = take_integers(a, samples);
    if (good(a)) {
        memcpy(&guard, memory, sizeof guard);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            verdicts[k] = guard_judge(&guard, x[k], y[k]);
        }
        memcpy(memory, &guard, sizeof guard);
    }
    return finish_integer(a, 0);
}
