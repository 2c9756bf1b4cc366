/* The learner of core/learner.h with the parameters of this export. */
#include "piezo.h"
#include "piezo_learner.h"

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function" /* some functions of the core are unused */
#endif

#ifdef PIEZO_FLOAT
#define CORE_FLOAT_SIGNALS
#endif
/* Constants of the core's enumerations in learner.h. */
#define CORE_MODE (PIEZO_LEARNING == PIEZO_CONTINUOUS ? CONTINUOUS : CYCLIC)
#define CORE_SOLVER (PIEZO_LEARNING == PIEZO_CONTINUOUS ? EXACT : PIEZO_LEARNING == PIEZO_STEPS ? STEPS : ANSWERED)

#include "core/box_data.c"
#include "core/box_dual.c"
#include "core/box_inverse.c"
#include "core/box_proximal.c"

#include "core/descent.c"
#if PIEZO_LEARNING == PIEZO_ACCELERATED
#include "core/acceleration.c"
#endif

#include "core/continuous.c"
#include "core/cyclic.c"
#include "core/learner.c"
#include "core/noise.c"
#include "core/offer.c"
#include "core/optimum.c"

static const double thresholds[] = PIEZO_R_H, zone_low[] = PIEZO_ZONE_LOW, zone_high[] = PIEZO_ZONE_HIGH;
static const double outer_low[] = PIEZO_OUTER_LOW, outer_high[] = PIEZO_OUTER_HIGH;
#if PIEZO_RATES > 0
static const double creep_gains[] = PIEZO_CREEP_GAINS;
#endif

static void set_regressors(const Regressors *p)
{
    memcpy(p->operators.r, thresholds, sizeof thresholds);
#if PIEZO_RATES > 0
    memcpy(p->operators.a, creep_gains, sizeof creep_gains);
#endif
    for (int i = 0; i < zone_lanes(exported_shape); ++i) {
        p->low[i] = i < PIEZO_ZONES ? zone_low[i] : -REAL_INFINITY;
        p->high[i] = i < PIEZO_ZONES ? zone_high[i] : REAL_INFINITY;
        p->outer_low[i] = i < PIEZO_ZONES ? outer_low[i] : -REAL_INFINITY;
        p->outer_high[i] = i < PIEZO_ZONES ? outer_high[i] : REAL_INFINITY;
    }
}

void piezo_learner_reset(void *learner)
{
    const LearnerSettings settings = {
        .mode = CORE_MODE,
        .solver = CORE_SOLVER,
        .middle = PIEZO_MIDDLE,
        .reset_lasts = PIEZO_RESET_SAMPLES,
        .forgetting = PIEZO_FORGETTING,
        .row_weight = PIEZO_ROW_WEIGHT,
        .proximal = PIEZO_PROXIMAL,
        .min_slope = PIEZO_MIN_SLOPE,
#if PIEZO_LEARNING == PIEZO_CONTINUOUS
        .interval = PIEZO_INTERVAL,
        .checkpoint = PIEZO_CHECKPOINT,
        .half_window = PIEZO_HALF_WINDOW,
        .smoothing = PIEZO_SMOOTHING,
#else
        .build_lasts = PIEZO_BUILD_SAMPLES,
        .learn_lasts = PIEZO_LEARN_SAMPLES,
        .solve_lasts = PIEZO_SAMPLES_TO_SOLVE,
        .step_ratio = PIEZO_STEP_RATIO,
#endif
    };
    const Learner l = learner_setup(learner, exported_shape, PIEZO_BLOCK, PIEZO_BLOCKS, CORE_MODE);
    memcpy((void *)(uintptr_t)l.settings, &settings, sizeof settings);
    set_regressors(&l.regressors);
#if PIEZO_RING > 0
    l.mailbox.noise_gains[0] = (shared)PIEZO_NOISE_GAIN;
    l.mailbox.noise_gains[1] = (shared)PIEZO_NOISE_OF_THIRD;
#endif
}

void piezo_learner_begin(void *learner, const double *weights)
{
    const Learner l = learner_at(learner);
    unknowns_of(l.shape, PIEZO_MIDDLE, weights, l.in_use);
    learner_begin(&l, 1, 1);
}

#if PIEZO_LEARNING == PIEZO_EXACT
/* Solve the program of a cycle, warm-started from the weights in use. */
static int solve_cycle(const Learner *l)
{
    const Cyclic *const c = &l->cyclic;
    void *const memory = workspace_of(l).solver;
    const int solved = box_solve_from(memory, l->d, c->P, c->q, c->lower, c->upper, c->start) == OK;
    if (solved) {
        memcpy(c->answer, box_at(memory).answer, (size_t)l->d * sizeof(real));
    }
    return solved;
}
#elif PIEZO_LEARNING == PIEZO_ACCELERATED
static int solve_cycle(const Learner *l)
{
    const ProjectedGradient *const descent = &l->cyclic.descent;
    if (!begin_steps(l)) {
        return 0;
    }
    accelerated_steps(descent, PIEZO_STEPS_OF_A_SOLVE, PIEZO_SOLVE_TOLERANCE);
    descent_answer(descent);
    return descent->head->met;
}
#endif

/* Update the counters that other threads may read. */
static void publish_counts(piezo_axis *axis, const Learner *l)
{
    const LearnerMemory *const m = l->memory;
    const num counts[] = {m->hand_overs, m->refusals, m->faults, m->failures};
    for (int i = 0; i < PIEZO_LEARNED; ++i) {
        CORE_RELEASE(axis->learned + i, (uint32_t)counts[i]);
    }
}

int piezo_learn(piezo_axis *axis)
{
    const Learner l = learner_at(axis->learner.bytes);
    const MailboxHead *const m = l.mailbox.head;
    if (CORE_ACQUIRE(&m->published) == m->consumed) {
        return 0;
    }
#if PIEZO_LEARNING == PIEZO_EXACT || PIEZO_LEARNING == PIEZO_ACCELERATED
    if ((learner_learn(&l) & PROGRAM) && !solve_cycle(&l)) {
        l.cyclic.answer[0] = (real)NAN; /* the learner refuses it */
    }
#else
    learner_learn(&l);
#endif
    publish_counts(axis, &l);
    return 1;
}

piezo_events piezo_get_events(const piezo_axis *axis)
{
    const Learner l = learner_at((void *)(uintptr_t)axis->learner.bytes);
    const MailboxHead *const m = l.mailbox.head;
    return (piezo_events){.hand_overs = CORE_ACQUIRE(axis->learned),
                          .refusals = CORE_ACQUIRE(axis->learned + 1),
                          .sensor_faults = CORE_ACQUIRE(axis->learned + 2),
                          .numeric_faults = CORE_ACQUIRE(axis->learned + 3),
                          .late_offers = CORE_ACQUIRE(&m->late),
                          .dropped_blocks = CORE_ACQUIRE(&m->dropped)};
}
