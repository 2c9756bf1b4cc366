/* The learner of core/cyclic.h or core/continuous.h with the parameters of this export. */
#include "piezo.h"
#include "piezo_learner.h"

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function" /* not every function of the core is needed here */
#endif

#if PIEZO_LEARNING == PIEZO_CONTINUOUS || PIEZO_LEARNING == PIEZO_EXACT
#include "core/box_data.c"
#include "core/box_dual.c"
#include "core/box_exchange.c"
#include "core/box_factor.c"
#include "core/box_inverse.c"
#include "core/box_pivoting.c"
#endif
#if PIEZO_LEARNING == PIEZO_CONTINUOUS
#include "core/swept_exchange.c"
#include "core/swept_gram.c"
#include "core/swept_refresh.c"
#include "core/swept_renewal.c"
#include "core/swept_rows.c"

#include "core/continuous.c"
typedef Continuous Learner;
#define learner_at continuous_at
#else
#include "core/eigenvalue.c"

#include "core/data_basis.c"
#include "core/descent.c"
#if PIEZO_LEARNING == PIEZO_ACCELERATED
#include "core/acceleration.c"
#endif

#include "core/cyclic.c"
typedef Cyclic Learner;
#define learner_at cyclic_at
#endif

static const double thresholds[] = PIEZO_R_H, zone_low[] = PIEZO_ZONE_LOW, zone_high[] = PIEZO_ZONE_HIGH;
static const double outer_low[] = PIEZO_OUTER_LOW, outer_high[] = PIEZO_OUTER_HIGH;
#if PIEZO_RATES > 0
static const double creep_gains[] = PIEZO_CREEP_GAINS;
#endif

static void set_regressors(Regressors *p, Shape shape)
{
    memcpy(p->operators.r, thresholds, sizeof thresholds);
#if PIEZO_RATES > 0
    for (int i = 0; i < creep_lanes(shape); ++i) {
        p->operators.a[i] = creep_gains[i / lanes(shape)];
    }
#endif
    for (int i = 0; i < zone_lanes(shape); ++i) {
        p->low[i] = i < PIEZO_ZONES ? zone_low[i] : -REAL_INFINITY;
        p->high[i] = i < PIEZO_ZONES ? zone_high[i] : REAL_INFINITY;
        p->outer_low[i] = i < PIEZO_ZONES ? outer_low[i] : -REAL_INFINITY;
        p->outer_high[i] = i < PIEZO_ZONES ? outer_high[i] : REAL_INFINITY;
    }
}

void piezo_learner_reset(void *learner, const double *weights, const double *play, const double *creep)
{
    const Shape shape = CORE_SHAPE;
    const Scales scales = {PIEZO_X_CENTRE, PIEZO_X_SCALE, PIEZO_Y_CENTRE, PIEZO_Y_SCALE};
    Learner l;
#if PIEZO_LEARNING == PIEZO_CONTINUOUS
    const ContinuousSettings settings = {PIEZO_RESET_SAMPLES, PIEZO_INTERVAL, PIEZO_CHECKPOINT, PIEZO_HALF_WINDOW, PIEZO_SMOOTHING,
                                         PIEZO_MIN_SLOPE};
    continuous_setup(learner, shape, PIEZO_MIDDLE, PIEZO_MIN_SLOPE, PIEZO_FORGETTING, PIEZO_PROXIMAL, PIEZO_MOST_EXCHANGES);
    l = learner_at(learner);
    l.memory->settings = settings;
    set_regressors(&l.regressors, shape);
    memcpy(l.play, play, (size_t)lanes(shape) * sizeof(real));
    memcpy(l.creep, creep, (size_t)creep_lanes(shape) * sizeof(real));
    unknowns_of(shape, PIEZO_MIDDLE, weights, l.in_use + 1);
    l.memory->counts.left = PIEZO_RESET_SAMPLES;
    continuous_begin_anew(&l, 0);
#else
    const CyclicSettings settings = {PIEZO_RESET_SAMPLES, PIEZO_BUILD_SAMPLES, PIEZO_LEARN_SAMPLES, PIEZO_LEARNING == PIEZO_STEPS,
                                     PIEZO_PROXIMAL, PIEZO_MIN_SLOPE, PIEZO_STEP_RATIO};
    cyclic_setup(learner, shape, PIEZO_MIDDLE);
    l = learner_at(learner);
    l.memory->settings = settings;
    set_regressors(&l.basis.regressors, shape);
    memcpy(l.basis.play, play, (size_t)lanes(shape) * sizeof(real));
    memcpy(l.basis.creep, creep, (size_t)creep_lanes(shape) * sizeof(real));
    unknowns_of(shape, PIEZO_MIDDLE, weights, l.in_use);
    cyclic_enter(&l, RESET);
#endif
    l.memory->scales = scales;
}

#if PIEZO_LEARNING == PIEZO_EXACT
/* The program solved at once, warm from the weights in use. */
static int solve(Cyclic *c)
{
    char *const memory = (char *)c->head + room_bytes(cyclic_bytes(c->shape));
    Box box;
    if (box_setup(memory, c->d, c->lower, c->upper) != OK) {
        return 0;
    }
    box = box_at(memory);
    if (box_take_hessian(&box, c->P) != OK || box_take_linear(&box, c->q) != OK || box_start(&box, c->start) != OK) {
        return 0;
    }
    const int status = box_solve(&box, 1);
    memcpy(c->answer, box.answer, (size_t)c->d * sizeof(real));
    return status == OK || status == CAPPED;
}
#elif PIEZO_LEARNING == PIEZO_ACCELERATED
static int solve(Cyclic *c)
{
    if (descent_setup(c->descent.head, c->d, c->lower, c->upper) != OK || descent_take(&c->descent, c->P, c->q, 0.5, 1) != OK) {
        return 0;
    }
    descent_start(&c->descent, c->start);
    accelerated_steps(&c->descent, PIEZO_STEPS_OF_A_SOLVE, PIEZO_SOLVE_TOLERANCE);
    descent_answer(&c->descent);
    return c->descent.head->met;
}
#endif

int piezo_learner_observe(void *learner, double x, double y, double *weights)
{
    Learner l = learner_at(learner);
#if PIEZO_LEARNING == PIEZO_CONTINUOUS
    const int brought = continuous_observe(&l, x, y);
#else
    const int brought = cyclic_observe(&l, x, y);
#endif
#if PIEZO_LEARNING == PIEZO_EXACT || PIEZO_LEARNING == PIEZO_ACCELERATED
    if (brought & PROGRAM) {
        l.memory->counts.left = PIEZO_SAMPLES_TO_SOLVE;
        if (!solve(&l)) {
            ++l.memory->counts.refusals;
            cyclic_enter(&l, RESET);
        }
    }
#endif
    if (brought & TAKE_OVER) {
        memcpy(weights, l.weights, PIEZO_ALL_WEIGHTS * sizeof(double));
        return 1;
    }
    return 0;
}

int piezo_learner_trusts(void *learner) { return learner_at(learner).memory->counts.last_verdict == GOOD; }

void piezo_learner_events(void *learner, long long *counts)
{
    const LearningCounts *const n = &learner_at(learner).memory->counts;
    counts[0] = n->hand_overs;
    counts[1] = n->refusals;
    counts[2] = n->faults;
    counts[3] = n->failures;
}
