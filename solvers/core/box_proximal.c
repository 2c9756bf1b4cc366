/* Box problems whose P is singular or nearly so.
 *
 * The proximal term delta |z - c|^2 / 2 is added, in the scaled variables z (delta = BOX_PROXIMAL), and c is moved to
 * the answer until the term is below the rounding error of g. c starts at 0, or at the warm start: along directions in
 * the null space of P, x stays where it was. If P has a pivot <= 0 even with the term, it is refused as indefinite; if
 * x advances by constant steps, it is moved to the next bound on its way, and without one the problem is unbounded.
 *
 * Source: R. T. Rockafellar, "Monotone operators and the proximal point algorithm", SIAM J. Control Optim. 14 (1976)
 * 877.
 */
#include "box.h"

#include "sweep.h"

int box_sweep_free(const Box *s)
{
    const size_t d = (size_t)s->d, ld = (size_t)s->ld;
    int positive = 1;
    memcpy(s->M, s->P, d * ld * sizeof(real));
    for (size_t j = 0; j < d; ++j) {
        s->M[j * ld + j] += BOX_PROXIMAL;
    }
    for (size_t j = 0; positive && j < d; ++j) {
        if (s->side[j] == FREE) {
            positive = s->M[j * ld + j] > 0;
            sweep(s->M, s->d, s->ld, (int)j, s->step);
        }
    }
    for (size_t j = 0; j < d; ++j) {
        const int side = s->side[j];
        s->is_free[j] = side == FREE;
        s->held[j] = side == FREE ? 0 : side == LOWER ? s->lo[j] : s->hi[j];
        s->unit[j] = 1;
        s->diagonal[j] = s->M[j * ld + j];
        s->weight[j] = 1 / MAGNITUDE(s->diagonal[j]);
    }
    return positive;
}

int box_regularise(Box *s)
{
    s->head->singular = 1;
    for (int j = 0; j < s->d; ++j) {
        s->side[j] = FREE;
    }
    return box_sweep_free(s) ? OK : INDEFINITE;
}

/* The number of steps like the last one until x meets a bound. */
static real steps_to_bound(const Box *s, real negligible)
{
    real steps = REAL_INFINITY;
    for (int j = 0; j < s->d; ++j) {
        const real step = s->x[j] - s->centre[j];
        if (MAGNITUDE(step) > negligible) {
            const real fits = ((step > 0 ? s->hi[j] : s->lo[j]) - s->x[j]) / step;
            steps = fits < steps ? fits : steps;
        }
    }
    return steps;
}

int box_proximal_point(const Box *s, Search *search, int warm)
{
    real last = REAL_INFINITY;
    int status = OK;
    for (int j = 0; j < s->d; ++j) {
        const real x = warm ? s->answer[j] / s->scale[j] : 0;
        const int lower = s->side[j] == LOWER && s->lo[j] > -REAL_INFINITY,
                  upper = s->side[j] == UPPER && s->hi[j] < REAL_INFINITY;
        s->centre[j] = MAGNITUDE(x) < REAL_INFINITY ? x : 0;
        s->side[j] = warm && (lower || upper) ? s->side[j] : FREE;
        s->basic[j] = 0;
    }
    *search = (Search){.linear = s->linear};
    if (!box_sweep_free(s)) {
        return BREAKDOWN;
    }
    for (int most = 20 + 2 * s->d; most > 0; --most) {
        real length = 0, steps = 0;
        for (int j = 0; j < s->d; ++j) {
            s->linear[j] = s->q[j] - BOX_PROXIMAL * s->centre[j];
        }
        ++s->head->proximal_steps;
        status = box_dual_active_set(s, search);
        if (status != OK) {
            return status;
        }
        for (int j = 0; j < s->d; ++j) {
            const real moved = MAGNITUDE(s->x[j] - s->centre[j]);
            length = moved > length ? moved : length;
        }
        if (BOX_PROXIMAL * length <= (real)s->d * search->rounding / 2) { /* the tolerance on g_F of box_dual.c */
            return OK;
        }
        if ((real)0.99 * last < length && length < (real)1.01 * last
            && BOX_PROXIMAL * length > 64 * (real)s->d * search->rounding) {
            steps = steps_to_bound(s, (real)1e-9 * length);
            if (steps == REAL_INFINITY) {
                return UNBOUNDED;
            }
        }
        for (int j = 0; j < s->d; ++j) {
            s->centre[j] = s->x[j] + steps * (s->x[j] - s->centre[j]);
        }
        last = length;
    }
    return OK;
}
