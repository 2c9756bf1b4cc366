/* The optimum of an interval of each learner, over v >= lb,
 *
 *     minimise 1/2 v'Pv + q'v + 1/2 sum of rho_j (v_j - c_j)^2,   G = (P q; q' .),
 *
 * where rho_j is `proximal` times P_jj, at most the mean diagonal, and c the optimum before, which holds undetermined
 * directions. Unreached unknowns (a dead zone beyond the range), whose diagonal decays, have the rho of the mean. The
 * exact solver starts from the bounds that were active in the optimum before, one learner after the other.
 */
#include "learner.h"

#define UNREACHED ((real)1e-20) /* share of the mean diagonal below which an unknown is unreached */

void N(learner_program)(const Learner *l, int lane)
{
    const int d = l->d;
    const Workspace work = workspace_of(l), *const w = &work;
    real mean = 0;
    for (int i = 0; i < d; ++i) {
        for (int j = i; j < d; ++j) {
            w->P[i * d + j] = w->P[j * d + i] = *entry(l->gram, symmetric_row(d + 1, i) + j, lane);
        }
        mean += w->P[i * d + i];
    }
    mean /= (real)d;
    for (int i = 0; i < d; ++i) {
        const real diagonal = w->P[i * d + i], least = diagonal < mean ? diagonal : mean;
        const real rho = l->settings->proximal * (diagonal > UNREACHED * mean ? least : mean);
        w->start[i] = *entry(l->candidate, i, lane);
        w->P[i * d + i] = diagonal + rho;
        w->q[i] = *entry(l->gram, symmetric_row(d + 1, i) + d, lane) - rho * w->start[i];
        w->lb[i] = lower_bound(l, i);
        w->ub[i] = REAL_INFINITY;
    }
    N(noise_subtract)(l, w, lane);
}

/* Solve the program of a lane; its optimum becomes the candidate. Whether there is one. */
static int solve(const Learner *l, int lane)
{
    const Workspace work = workspace_of(l), *const w = &work;
    Box s = box_at(w->solver);
    const int is_solved = box_start(&s, w->start) == OK && box_solve(&s, 1) == OK;
    for (int i = 0; is_solved && i < l->d; ++i) {
        *entry(l->candidate, i, lane) = s.answer[i];
    }
    return is_solved;
}

num N(learner_optimum)(const Learner *l, num which)
{
    num failed = constant(0);
    for (int lane = 0; lane < WIDTH; ++lane) {
        if (*entry(&which, 0, lane) > 0) {
            N(learner_program)(l, lane);
            *entry(&failed, 0, lane) = !solve(l, lane);
        }
    }
    return failed;
}
