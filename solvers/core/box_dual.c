/* The dual active set method for bounds, finite where block pivoting cycles.
 *
 * Goldfarb & Idnani (Math. Programming 27 (1983) 1) keep every multiplier right and mend one violated bound at a time. For a box
 * their step needs no Schur complement: between the candidate (x, u) of the set A and the candidate (x', g') of A and j every
 * quantity is linear, so u + t (g' - u), t in [0, 1], is the path. If a multiplier reaches zero at t < 1, its bound is let go there
 * and the path bends; t = 1 is j at its bound and the other multipliers right. The dual objective strictly rises with each bound
 * pushed home (at most |A| bends come before), so no set returns.
 */
#include "box.h"

/* Free bounds whose multiplier has the wrong sign until none has; at the latest, when no bound is left. */
static int free_wrong_signs(Box *s)
{
    for (;;) {
        const real tolerance = box_gradient_tolerance(s);
        int freed = 0;
        for (int j = 0; j < s->d; ++j) {
            if (s->side[j] != FIXED && (real)s->side[j] * s->g[j] > tolerance) {
                s->side[j] = FREE;
                ++freed;
            }
        }
        if (freed == 0) {
            return 1;
        }
        box_list_free(s);
        if (!box_newton(s)) {
            return 0;
        }
    }
}

/* The bound whose multiplier is zero first on the way to the candidate, and in `length` where; -1 and 1 if none is. */
static int first_to_vanish(const Box *s, int pushed, real *length)
{
    const real tolerance = box_gradient_tolerance(s);
    int let_go = -1;
    *length = 1;
    for (int j = 0; j < s->d; ++j) {
        const real u = s->multiplier[j], g = s->g[j];
        if (j != pushed && s->side[j] != FIXED && (real)s->side[j] * g > tolerance) {
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
static int most_violated(const Box *s)
{
    int chosen = -1;
    real worst = 0;
    for (int j = 0; j < s->d; ++j) {
        const real under = s->lo[j] - s->x[j], over_it = s->x[j] - s->hi[j], violation = under > over_it ? under : over_it;
        if (s->side[j] == FREE && violation > worst) {
            chosen = j;
            worst = violation;
        }
    }
    return chosen;
}

/* Solve from the sides as they are, after a Newton step on them; OK, BREAKDOWN or ENDLESS. */
int box_dual_active_set(Box *s)
{
    if (!free_wrong_signs(s)) {
        return BREAKDOWN;
    }
    memcpy(s->multiplier, s->g, (size_t)s->ld * sizeof(real));
    for (int most = 100 + 20 * s->d; most > 0; --most) {
        const int pushed = most_violated(s);
        int let_go = pushed;
        if (pushed < 0) {
            return OK;
        }
        box_move(s, pushed, s->x[pushed] < s->lo[pushed] ? LOWER : UPPER);
        s->multiplier[pushed] = 0;
        while (let_go >= 0) {
            real t;
            ++s->head->dual_steps;
            box_list_free(s);
            if (!box_newton(s)) {
                return BREAKDOWN;
            }
            let_go = first_to_vanish(s, pushed, &t);
            for (int j = 0; j < s->d; ++j) {
                s->multiplier[j] += t * (s->g[j] - s->multiplier[j]);
            }
            if (let_go >= 0) {
                s->side[let_go] = FREE;
                s->multiplier[let_go] = 0;
            }
        }
    }
    return ENDLESS;
}
