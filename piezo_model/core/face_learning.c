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
    const double *const x = take_array(a, VECTOR, (int)samples), *const y_ref = driving ? x : NULL;
    double *const driven = driving ? take_output(a, VECTOR, (int)samples) : NULL;
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

static PyObject *learn_cyclic(const char *signature, PyObject *const *given, Py_ssize_t count, int driving)
{
    Arguments a;
    Compensator compensator;
    Cyclic c;
    Learner l = {&c, NULL};
    void *memory;
    take_arguments(&a, signature, given, count, driving ? 6 : 5);
    memory = take_learner(&a, CYCLIC_KIND, &compensator);
    if (good(&a)) {
        c = cyclic_at(memory);
    }
    return learn(&a, l, &compensator, driving);
}

static PyObject *learn_continuous(const char *signature, PyObject *const *given, Py_ssize_t count, int driving)
{
    Arguments a;
    Compensator compensator;
    Continuous c;
    Learner l = {NULL, &c};
    void *memory;
    take_arguments(&a, signature, given, count, driving ? 6 : 5);
    memory = take_learner(&a, CONTINUOUS_KIND, &compensator);
    if (good(&a)) {
        c = continuous_at(memory);
    }
    return learn(&a, l, &compensator, driving);
}

FACE(face_cyclic_observe)
{
    (void)module;
    return learn_cyclic("cyclic_observe(state, compensator, y, x, first)", given, count, 0);
}

FACE(face_cyclic_drive)
{
    (void)module;
    return learn_cyclic("cyclic_drive(state, compensator, y, y_ref, x, first)", given, count, 1);
}

FACE(face_continuous_observe)
{
    (void)module;
    return learn_continuous("continuous_observe(state, compensator, y, x, first)", given, count, 0);
}

FACE(face_continuous_drive)
{
    (void)module;
    return learn_continuous("continuous_drive(state, compensator, y, y_ref, x, first)", given, count, 1);
}

FACE(face_cyclic_bytes)
{
    (void)module;
    return size_for(cyclic_bytes, "cyclic_bytes(n, zones, rates, offset)", given, count);
}

FACE(face_cyclic_setup)
{
    Arguments a;
    Cyclic c;
    CyclicMemory *m;
    Shape s;
    void *memory;
    int middle;
    (void)module;
    take_arguments(&a, "cyclic_setup(state, n, zones, rates, offset, middle)", given, count, 6);
    memory = take_state(&a, 0);
    s = take_shape(&a);
    middle = (int)take_integer(&a, 0, s.zones - 1);
    need_bytes(&a, 0, cyclic_bytes(s));
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    cyclic_setup(memory, s, middle);
    c = cyclic_at(memory);
    m = c.memory;
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
    return finish_parts(&a, memory, parts, (int)(sizeof parts / sizeof *parts));
}

FACE(face_cyclic_enter)
{
    Arguments a;
    Cyclic c;
    void *memory;
    int phase;
    (void)module;
    take_arguments(&a, "cyclic_enter(state, phase)", given, count, 2);
    memory = take_state(&a, CYCLIC_KIND);
    phase = (int)take_integer(&a, RESET, LEARN);
    if (good(&a)) {
        c = cyclic_at(memory);
        cyclic_enter(&c, phase);
    }
    return finish_integer(&a, 0);
}

FACE(face_continuous_bytes)
{
    (void)module;
    return size_for(continuous_bytes, "continuous_bytes(n, zones, rates, offset)", given, count);
}

FACE(face_continuous_setup)
{
    Arguments a;
    Continuous c;
    ContinuousMemory *m;
    Shape s;
    void *memory;
    double min_slope, forgetting, proximal;
    int middle, most_exchanges;
    (void)module;
    take_arguments(&a, "continuous_setup(state, n, zones, rates, offset, middle, min_slope, forgetting, proximal, most_exchanges)", given, count, 10);
    memory = take_state(&a, 0);
    s = take_shape(&a);
    middle = (int)take_integer(&a, 0, s.zones - 1);
    min_slope = take_number(&a);
    forgetting = take_number(&a);
    proximal = take_number(&a);
    most_exchanges = (int)take_integer(&a, 0, INT32_MAX);
    need_bytes(&a, 0, continuous_bytes(s));
    if (!good(&a)) {
        return finish(&a, NULL);
    }
    continuous_setup(memory, s, middle, min_slope, forgetting, proximal, most_exchanges);
    c = continuous_at(memory);
    m = c.memory;
    const Part parts[] = {
        COUNTS(&m->counts), REGRESSORS(c.regressors, s), {"reset_lasts", &m->settings.reset_lasts, 1},
        {"interval", &m->settings.interval, 1}, {"checkpoint", &m->settings.checkpoint, 1},
        {"half_window", &m->settings.half_window, 1}, {"smoothing", &m->settings.smoothing, 1}, {"scales", &m->scales, 4},
        {"guard", &m->guard, 5}, {"revert", &m->revert, 1}, {"has_fallback", &m->has_fallback, 1}, {"level", &m->level, 1},
        {"in_use", c.in_use + 1, c.d}, {"candidate", c.candidate + 1, c.d}, {"span", c.span, 4}, {"play", c.play, lanes(s)},
        {"creep", c.creep, creep_lanes(s)}};
    return finish_parts(&a, memory, parts, (int)(sizeof parts / sizeof *parts));
}

FACE(face_continuous_begin_anew)
{
    Arguments a;
    Continuous c;
    void *memory;
    double level;
    (void)module;
    take_arguments(&a, "continuous_begin_anew(state, level)", given, count, 2);
    memory = take_state(&a, CONTINUOUS_KIND);
    level = take_number(&a);
    if (good(&a)) {
        c = continuous_at(memory);
        continuous_begin_anew(&c, level);
    }
    return finish_integer(&a, 0);
}

FACE(face_guard_judge)
{
    Arguments a;
    SensorGuard guard;
    double *memory;
    const double *x, *y;
    int64_t *verdicts;
    Py_ssize_t samples, length = 0;
    (void)module;
    take_arguments(&a, "guard_judge(memory, x, y, verdicts)", given, count, 4);
    memory = take_output(&a, VECTOR, (int)(sizeof guard / sizeof(real)));
    x = take_array(&a, VECTOR, ANY_LENGTH);
    samples = taken_length(&a);
    y = take_array(&a, VECTOR, (int)samples);
    verdicts = take_integers(&a, &length);
    if (length != samples) {
        refuse(&a, "there is a verdict for each sample");
    }
    if (good(&a)) {
        memcpy(&guard, memory, sizeof guard);
        for (Py_ssize_t k = 0; k < samples; ++k) {
            verdicts[k] = guard_judge(&guard, x[k], y[k]);
        }
        memcpy(memory, &guard, sizeof guard);
    }
    return finish_integer(&a, 0);
}
