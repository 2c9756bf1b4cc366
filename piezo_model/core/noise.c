/* The contribution of the sensor's noise to the sums of the learner, and its subtraction.
 *
 * Let y = eta + e with white noise e of variance sigma^2. Of a row, only the slopes' columns -S(y) depend on y, and of
 * these only that of the piece p of S^-1 in which y lies, with the derivative -1. So Xi(y) = Xi(eta) - e e_p with the
 * unit vector e_p, and since x is exact and does not depend on the noise of its own sample,
 *
 *     E[Xi Xi'] = Xi(eta) Xi(eta)' + sigma^2 e_p e_p',   E[Xi x] = Xi(eta) x,   E[E^2] = E(eta)^2 + sigma^2 v_p^2.
 *
 * The noise raises the diagonal of P by sigma^2 n_p, which would make all slopes too small, and the squared error of
 * large slopes more than that of small ones. With the weights of G,
 *
 *     n <- lambda n + (1 - lambda) e_p                  how often y lies in each piece
 *     s <- lambda s + (1 - lambda) (third difference of E)^2 / 20
 *     t <- lambda t + (1 - lambda) v_p^2                v in use,   sigma^2 = s / t
 *
 * since a third difference removes whatever is smooth, also a jump that the model explains, and leaves
 * 1 + 9 + 9 + 1 = 20 variances v_p^2 sigma^2 of the noise. A sample counts at most CAP times the mean, so that a jump
 * that no model explains is not noise for a whole memory. The program of an interval gets P - sigma^2 diag(n):
 *
 * - a piece with P_pp < HOLD sigma^2 n_p, where the signal is hardly more than the noise, takes the slope in use of its
 *   inner neighbour;
 * - sigma^2 shrinks until P is positive definite by MARGIN sigma^2 diag(n), since both are estimates; the exact solver,
 *   which inverts P anyway, tells.
 *
 * With dynamics the learner's y passed F and an interpolation (prefilter.h), so that its noise is h * e with the
 * impulse response h. Its variance is sigma^2 sum h^2, that of its third differences sigma^2 sum (h * (1, -3, 3, -1))^2
 * instead of 20 sigma^2; the two sums are constants of the actuator. x is late by as many samples as most of h lasts,
 * so integral action, by which x depends on earlier noise, hardly correlates with the noise of the row.
 *
 * Third differences see the noise at high frequencies: of coloured noise (an autoregression of 0.9) they find 6 %, and
 * the rest stays in P. Of a sensor that is quantised, they find the steps as far as the output crosses them in each
 * sample.
 */
#include "learner.h"

#define CAP ((real)9)
#define LEAST_VARIANCE ((real)1e-6) /* below which CAP does not apply; noise of 0.05 % of the range */
#define HOLD ((real)4)
#define MARGIN ((real)0.02)
#define SHRINKING_NOISE ((real)0.7) /* factor on sigma^2 */
#define LEAST_SHARE ((real)0.01)    /* smallest share of sigma^2 that is tried */

num N(noise_variance)(const Learner *l)
{
    return divided(l->noise[SQUARES], greatest(l->noise[SLOPES], constant(TINY)));
}

/* Gain 0, sum h^2, or 1, one over that of the third differences. */
static num noise_gain(const Learner *l, int i)
{
    return l->shape.ring > 0 ? from_shared(l->mailbox.noise_gains, i) : constant(i == 0 ? 1 : (real)0.05);
}

CORE_INLINE vec8 less8(vec8 a, vec8 b) { return where_less(a, b, splat(1), zeros()); }
/* 1 for the piece of S^-1 in which y lies, else 0; 0 for all if y is NaN. */
CORE_INLINE vec8 active_pieces(const Regressors *p, int i, vec8 y)
{
    return add(sub(less8(y, PARAMETER(p->low, i)), less8(y, PARAMETER(p->high, i))),
               sub(less8(y, PARAMETER(p->outer_high, i)), less8(y, PARAMETER(p->outer_low, i))));
}

/* The squared slope v_p^2. */
static num squared_slope(const Learner *l, const num *v, num y)
{
    Sum sum = no_sum();
    for (int i = 0; i < VECTORS(l->shape.zones); ++i) {
        accumulate(&sum, i, active_pieces(&l->regressors, i, SPREAD(y)), vector(v + l->shape.n, i));
    }
    return times(total(&sum), total(&sum));
}

void N(noise_judge)(const Learner *l, const Block *block, BlockSummary *b)
{
    const num variance = N(noise_variance)(l),
              most = times(constant(CAP), greatest(variance, constant(LEAST_VARIANCE)));
    const num added = times(variance, noise_gain(l, 0)), of_third = noise_gain(l, 1);
    num *const before = l->memory->recent;
    for (int k = 0; k < b->count; ++k) {
        num *const row = workspace_of(l).rows + k * row_nums(l->shape), *const noise = row + row_nums(l->shape) - NOISE;
        const num y = from_shared(block->y, k);
        const num error = plus(dot(l->in_use, row + 1, VECTORS(l->d)), row[0]), slope = squared_slope(l, l->in_use, y);
        const num other = plus(dot(l->candidate, row + 1, VECTORS(l->d)), row[0]);
        const num third = plus(minus(error, before[2]), times(constant(3), minus(before[1], before[0])));
        const num square = times(times(third, third), of_third), known = is_finite(square);
        b->squares_in_use = plus(b->squares_in_use, minus_times(times(error, error), added, slope));
        b->squares_candidate =
            plus(b->squares_candidate, minus_times(times(other, other), added, squared_slope(l, l->candidate, y)));
        noise[SQUARES] = where(known, lowest(square, times(most, slope)), constant(0));
        noise[SLOPES] = logical_and(known, slope);
        memmove(before + 1, before, 2 * sizeof *before);
        before[0] = where(logical_and(l->memory->learning, is_finite(y)), error, constant((real)NAN));
    }
}

void N(noise_add)(const Learner *l, const Block *block, num learns)
{
    const LearnerSettings *const p = l->settings;
    for (int k = 0; k < block->head->count; ++k) {
        const num *const noise = workspace_of(l).rows + (k + 1) * row_nums(l->shape) - NOISE;
        const num y = from_shared(block->y, k), counts = logical_and(learns, is_finite(y));
        const num fade = where(counts, constant(p->forgetting), constant(1)),
                  weight = times(counts, constant(p->row_weight));
        for (int i = 0; i < VECTORS(l->shape.zones); ++i) {
            const vec8 counted = mul(SPREAD(weight), active_pieces(&l->regressors, i, SPREAD(y)));
            set_vector(l->pieces, i, flushed8(plus_product(counted, vector(l->pieces, i), SPREAD(fade))));
        }
        for (int i = 0; i < NOISE; ++i) {
            l->noise[i] = flushed(plus_times(times(weight, noise[i]), l->noise[i], fade));
        }
    }
}

/* Whether P is positive definite by MARGIN of the noise N on its diagonal, since trace(N P^-1) bounds the largest
 * eigenvalue of N^1/2 P^-1 N^1/2. */
static int is_definite(const Box *s, const real *noise)
{
    real trace = 0;
    for (int j = 0; j < s->d; ++j) {
        trace += noise[j] > 0 ? noise[j] * box_inverse_diagonal(s, j) : 0;
    }
    return trace < 1 / MARGIN;
}

/* Hold slope j at v. */
static void hold_slope(const Workspace *w, int d, int j, real v)
{
    for (int i = 0; i < d; ++i) {
        w->q[i] += w->P[i * d + j] * v;
        w->P[i * d + j] = w->P[j * d + i] = 0;
    }
    w->P[j * d + j] = 1;
    w->q[j] = -v;
    w->noise[j] = 0;
}

void N(noise_subtract)(const Learner *l, const Workspace *w, int lane)
{
    const num variance = times(N(noise_variance)(l), noise_gain(l, 0));
    const int d = l->d, first = l->shape.n, middle = first + (int)l->settings->middle;
    real share = 1, step = 1;
    box_setup(w->solver, d, w->lb, w->ub);
    Box s = box_at(w->solver);
    for (int j = 0; j < d; ++j) {
        const int is_slope = j >= first && j < first + l->shape.zones;
        w->noise[j] = is_slope ? *entry(&variance, 0, lane) * *entry(l->pieces, j - first, lane) : 0;
        if (w->P[j * d + j] < HOLD * w->noise[j]) {
            hold_slope(w, d, j, *entry(l->in_use, j > middle ? j - 1 : j < middle ? j + 1 : j, lane));
        }
    }
    for (;; share += step) {
        for (int j = 0; j < d; ++j) {
            w->P[j * d + j] -= step * w->noise[j];
        }
        box_set_data(&s, w->P, w->q);
        if (!(share > LEAST_SHARE) || is_definite(&s, w->noise)) {
            return;
        }
        step = share * (SHRINKING_NOISE - 1);
    }
}
