/* The optimum of an interval: of each learner, over v >= lb,
 *
 *     minimise 1/2 v'Pv + q'v + 1/2 sum of rho_j (v_j - c_j)^2,   G = (P q; q' .),
 *
 * rho_j being `proximal` times P_jj, at most the mean diagonal, and c the optimum before, so that what the data leave
 * open stays. What they do not reach at all (a dead zone beyond the range) is held like the mean: its diagonal fades
 * away. One system with the bounds that held the optimum before is often enough; what pivoting does not bring to an end
 * is left to the exact solver.
 */
#include "learner.h"

#define UNREACHED ((real)1e-20) /* share of the mean diagonal below which data say nothing */

void N(learner_program)(const Learner *l)
{
    const int d = l->d;
    const Pivoting program = workspace_of(l).program, *const s = &program;
    num mean = constant(0);
    memcpy(s->data, l->gram, sizeof(num) * (size_t)symmetric_nums(d + 1));
    for (int i = 0; i < d; ++i) {
        mean = plus(mean, l->gram[symmetric_row(d + 1, i) + i]);
    }
    mean = divided(mean, constant((real)d));
    for (int i = 0; i < d; ++i) {
        num *const row = s->data + symmetric_row(d + 1, i);
        const num diagonal = row[i], before = l->candidate[i], lower = constant(lower_bound(l, i));
        const num reached = less(times(constant(UNREACHED), mean), diagonal);
        const num rho = times(constant(l->settings->proximal), choose(reached, lowest(diagonal, mean), mean));
        row[i] = s->diagonal[i] = plus(diagonal, rho);
        s->q[i] = minus_times(row[d], rho, before);
        s->x[i] = constant(0);
        s->lb[i] = lower;
        s->ub[i] = constant(REAL_INFINITY);
        s->side[i] = if_less(lower, before, constant(0), constant(-1)); /* the bounds that held the optimum before */
    }
}

int N(learner_solve_exactly)(const Learner *l, const Pivoting *program, int lane)
{
    const int d = l->d;
    const Workspace work = workspace_of(l), *const w = &work;
    for (int i = 0; i < d; ++i) {
        for (int j = i; j < d; ++j) {
            w->P[i * d + j] = w->P[j * d + i] =
                ((const real *)program->data)[(symmetric_row(d + 1, i) + j) * WIDTH + lane];
        }
        w->q[i] = ((const real *)program->q)[i * WIDTH + lane];
        w->lb[i] = lower_bound(l, i);
        w->ub[i] = REAL_INFINITY;
    }
    box_setup(w->exact, d, w->lb, w->ub);
    Box s = box_at(w->exact);
    const int solved = box_solve_anew(&s, w->P, w->q, w->lb, w->ub) == OK;
    for (int i = 0; i < d && solved; ++i) {
        ((real *)program->x)[i * WIDTH + lane] = s.answer[i];
    }
    return solved;
}

#ifndef CORE_TILE
int learner_optimum(const Learner *l, num which)
{
    LearnerMemory *const m = l->memory;
    const Pivoting program = workspace_of(l).program, *const s = &program;
    num broken = which, solved = 0;
    if (SOLVER(l->settings) == ANSWERED) {
        return PROGRAM;
    }
    learner_program(l);
    if (pivoting_prepare(s) > 0) {
        for (int round = 0; round < MOST_ROUNDS && broken > 0; ++round) {
            solved = pivoting_round(s, &broken);
        }
    }
    if (!(solved > 0)) {
        m->alone += 1;
        solved = learner_solve_exactly(l, s, 0);
    }
    if (!(solved > 0)) {
        m->failures += 1;
        m->noted = 0; /* what has just been noted is no better */
        learner_begin_anew(l, 1, m->level);
        return NO_OPTIMUM;
    }
    memcpy(l->candidate, s->x, sizeof(real) * (size_t)l->d);
    return 0;
}
#endif
