/* The dual active set method for bounds, finite where block pivoting cycles.
 *
 * Goldfarb & Idnani (Math. Programming 27 (1983) 1) keep every multiplier right and mend one violated bound at a time.
 * For a box their step needs no Schur complement: between the candidate (x, u) of the set A and the candidate (x', g')
 * of A and j every quantity is linear, so u + t (g' - u), t in [0, 1], is the path. If a multiplier reaches zero at t <
 * 1, its bound is let go there and the path bends; t = 1 is j at its bound and the other multipliers right. The dual
 * objective strictly rises with each bound pushed home (at most |A| bends come before), so no set returns.
 */
#include "box_fallback.h"

/* Free bounds whose multiplier has the wrong sign until none has; at the latest, when no bound is left. */
static int free_wrong_signs(const Fallback *f)
{
    const Pivoting *const p = &f->program;
    for (;;) {
        const real tolerance = pivoting_rounding(p);
        int freed = 0;
        for (int j = 0; j < p->d; ++j) {
            if (p->lb[j] < p->ub[j] && p->side[j] * p->g[j] > tolerance) {
                p->side[j] = FREE;
                ++freed;
            }
        }
        if (freed == 0) {
            return 1;
        }
        if (!box_newton(f)) {
            return 0;
        }
    }
}

/* The bound whose multiplier is zero first on the way to the candidate, and in `length` where; -1 and 1 if none is. */
static int first_to_vanish(const Fallback *f, int pushed, real *length)
{
    const Pivoting *const p = &f->program;
    const real tolerance = pivoting_rounding(p);
    int let_go = -1;
    *length = 1;
    for (int j = 0; j < p->d; ++j) {
        const real u = f->multiplier[j], g = p->g[j];
        if (j != pushed && p->lb[j] < p->ub[j] && p->side[j] * g > tolerance) {
            const real along = u / (u - g), t = along > 0 ? along : 0;
            if (let_go < 0 || t < *length) {
                let_go = j;
                *length = t;
            }
        }
    }
    return let_go;
}

/* The free variable that breaks a bound most; -1 where none does. */
static int most_violated(const Pivoting *p)
{
    int chosen = -1;
    real worst = 0;
    for (int j = 0; j < p->d; ++j) {
        const real under = p->lb[j] - p->x[j], over_it = p->x[j] - p->ub[j],
                   violation = under > over_it ? under : over_it;
        if (p->side[j] == FREE && violation > worst) {
            chosen = j;
            worst = violation;
        }
    }
    return chosen;
}

/* Solve from the sides as they are; OK, BREAKDOWN or ENDLESS. */
int box_dual_active_set(const Fallback *f)
{
    const Pivoting *const p = &f->program;
    if (!box_newton(f) || !free_wrong_signs(f)) {
        return BREAKDOWN;
    }
    memcpy(f->multiplier, p->g, (size_t)p->d * sizeof(real));
    for (int most = 100 + 20 * p->d; most > 0; --most) {
        const int pushed = most_violated(p);
        int let_go = pushed;
        if (pushed < 0) {
            return OK;
        }
        p->side[pushed] = p->x[pushed] < p->lb[pushed] ? LOWER : UPPER;
        f->multiplier[pushed] = 0;
        while (let_go >= 0) {
            real t;
            ++f->head->dual_steps;
            if (!box_newton(f)) {
                return BREAKDOWN;
            }
            let_go = first_to_vanish(f, pushed, &t);
            for (int j = 0; j < p->d; ++j) {
                f->multiplier[j] += t * (p->g[j] - f->multiplier[j]);
            }
            if (let_go >= 0) {
                p->side[let_go] = FREE;
                f->multiplier[let_go] = 0;
            }
        }
    }
    return ENDLESS;
}
