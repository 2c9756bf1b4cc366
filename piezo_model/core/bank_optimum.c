/* The optimum of an interval: of each lane, over v >= lb,
 *
 *     minimise 1/2 v'Pv + q'v + 1/2 sum of rho_j (v_j - c_j)^2,   G = (P q; q' .),
 *
 * rho_j being `proximal` times P_jj, at most the mean diagonal, and c the optimum before, so that what the data leave open stays. One
 * system with the bounds that held the optimum before is often enough. The programs for which it is not go on in a queue, where a lane
 * that is done takes the next one, whatever tile it is from; what pivoting does not bring to an end is left to the exact solver.
 */
#include "bank_learning.h"

/* The optimum of one lane by the exact solver, beginning with every variable free; 1 where it has one. */
static int solve_alone(const Bank *b, const Workspace *w, const BoxLanes *program, int l)
{
    const int d = b->d;
    Box s;
    int solved;
    for (int i = 0; i < d; ++i) {
        const real *const row = lane8(program->data, triangle_row(d + 1, i)) + l;
        for (int j = i; j < d; ++j) {
            w->P[i * d + j] = w->P[j * d + i] = row[j * LANES];
        }
        w->q[i] = row[d * LANES];
        w->lb[i] = lower_bound(b, i);
        w->ub[i] = REAL_INFINITY;
    }
    box_setup(w->single, d, w->lb, w->ub);
    s = box_at(w->single);
    solved = box_solve_anew(&s, w->P, w->q, w->lb, w->ub) == OK;
    for (int i = 0; i < d && solved; ++i) {
        program->x[i * LANES + l] = s.answer[i];
    }
    return solved;
}

/* The optimum of a lane of the program becomes the candidate of this actuator, which begins anew if its data have none. */
static void finish(const Bank *b, const Workspace *w, const BoxLanes *program, int l, int actuator, int solved)
{
    const Tile tile = tile_at(b, actuator / LANES), *const t = &tile;
    const int lane = actuator % LANES;
    if (!solved) {
        MEMORY(ALONE)[lane] += 1;
        solved = solve_alone(b, w, program, l);
    }
    for (int i = 0; i < b->d && solved; ++i) {
        t->candidate[i * LANES + lane] = program->x[i * LANES + l];
    }
    if (!solved) {
        MEMORY(NOTED)[lane] = 0; /* what has just been noted is no better */
        tile_begin_anew(b, t, with_lane(zeros(), lane, 1), load(MEMORY(LEVEL)));
    }
}

/* Solve one system of each program in the queue. */
static void move_queue_on(const Bank *b, const Workspace *w)
{
    real solved[LANES], broken[LANES];
    vec8 more;
    store(solved, box_lanes_round(&w->queue, &more));
    store(broken, more);
    for (int l = 0; l < LANES; ++l) {
        if (w->owner[l] > 0 && (++w->rounds[l] == BOX_ROUNDS || !(broken[l] > 0))) {
            finish(b, w, &w->queue, l, w->owner[l] - 1, solved[l] > 0);
            w->owner[l] = 0;
        }
    }
}

static void line_up(const Bank *b, const Workspace *w, int l, int actuator)
{
    int into = 0;
    while (w->owner[into] > 0) {
        into = (into + 1) % LANES;
        if (into == 0) {
            move_queue_on(b, w);
        }
    }
    box_lanes_move(&w->program, l, &w->queue, into);
    w->owner[into] = actuator + 1;
    w->rounds[into] = 1;
}

void wait_for_optima(const Bank *b, const Workspace *w, int first, int last)
{
    for (int l = 0; l < LANES; ++l) {
        while (w->owner[l] > first * LANES && w->owner[l] <= (last + 1) * LANES) {
            move_queue_on(b, w);
        }
    }
}

void find_optima(const Bank *b, const Tile *t, const Workspace *w, vec8 which)
{
    const int d = b->d;
    const BoxLanes *const program = &w->program;
    vec8 mean = zeros(), found, more;
    real wanted[LANES], solved[LANES], broken[LANES];
    memcpy(program->data, t->gram, sizeof(real) * LANES * (size_t)triangle(d + 1));
    for (int i = 0; i < d; ++i) {
        mean = add(mean, load(lane8(t->gram, triangle_row(d + 1, i) + i)));
    }
    mean = over(mean, splat((real)d));
    for (int i = 0; i < d; ++i) {
        real *const row = lane8(program->data, triangle_row(d + 1, i));
        const vec8 diagonal = load(row + i * LANES), share = where_less(zeros(), diagonal, smaller(diagonal, mean), mean);
        const vec8 rho = mul(splat(b->settings->proximal), share), before = load(lane8(t->candidate, i)), lower = splat(lower_bound(b, i));
        store(row + i * LANES, add(diagonal, rho));
        store(row + d * LANES, less_product(load(row + d * LANES), rho, before));
        store(lane8(program->lb, i), lower);
        store(lane8(program->ub, i), splat(REAL_INFINITY));
        store(lane8(program->side, i), where_less(lower, before, zeros(), splat(-1))); /* the bounds that held the optimum before */
    }
    found = box_lanes_round(program, &more);
    copy_where(mul(which, found), t->candidate, program->x, d);
    store(wanted, which);
    store(solved, found);
    store(broken, more);
    for (int l = 0; l < LANES; ++l) {
        if (wanted[l] > 0 && broken[l] > 0) {
            line_up(b, w, l, t->number * LANES + l);
        } else if (wanted[l] > 0 && !(solved[l] > 0)) {
            finish(b, w, program, l, t->number * LANES + l, 0);
        }
    }
}
