/* The programs of a bank for which one system is not enough go on in a queue, where a lane that is done takes the next
 * one, whatever tile it is from. See optimum.c. */
#define CORE_TILE
#include "bank.h"

/* The optimum of a lane of the program becomes the candidate of this actuator, which begins anew if its data have none.
 */
static void finish(const Bank *b, void *workspace, const Pivoting *program, int lane, int actuator, int solved)
{
    const Learner learner = tile_learner(b, actuator / LANES, workspace), *const l = &learner;
    const int to = actuator % LANES;
    if (!solved) {
        ((real *)&l->memory->alone)[to] += 1;
        solved = tile_learner_solve_exactly(l, program, lane);
    }
    for (int i = 0; i < l->d && solved; ++i) {
        ((real *)l->candidate)[i * LANES + to] = ((const real *)program->x)[i * LANES + lane];
    }
    if (!solved) {
        ((real *)&l->memory->failures)[to] += 1;
        ((real *)&l->memory->noted)[to] = 0; /* what has just been noted is no better */
        tile_learner_begin_anew(l, with_lane(zeros(), to, 1), l->memory->level);
    }
}

/* Solve one system of each program in the queue. */
static void move_queue_on(const Bank *b, void *workspace)
{
    const Workspace work = workspace_at(workspace, b->shape, b->head->block, CONTINUOUS), *const w = &work;
    real solved[LANES], broken[LANES];
    num more;
    store(solved, tile_pivoting_round(&w->queue, &more));
    store(broken, more);
    for (int lane = 0; lane < LANES; ++lane) {
        if (w->owner[lane] > 0 && (++w->rounds[lane] == MOST_ROUNDS || !(broken[lane] > 0))) {
            finish(b, workspace, &w->queue, lane, w->owner[lane] - 1, solved[lane] > 0);
            w->owner[lane] = 0;
        }
    }
}

static void line_up(const Bank *b, void *workspace, int lane, int actuator)
{
    const Workspace work = workspace_at(workspace, b->shape, b->head->block, CONTINUOUS), *const w = &work;
    int into = 0;
    while (w->owner[into] > 0) {
        into = (into + 1) % LANES;
        if (into == 0) {
            move_queue_on(b, workspace);
        }
    }
    pivoting_move(&w->program, lane, &w->queue, into);
    w->owner[into] = actuator + 1;
    w->rounds[into] = 1;
}

void bank_wait(const Bank *b, void *workspace, int first, int last)
{
    const int32_t *const owner = workspace_at(workspace, b->shape, b->head->block, CONTINUOUS).owner;
    for (int lane = 0; lane < LANES; ++lane) {
        while (owner[lane] > first * LANES && owner[lane] <= (last + 1) * LANES) {
            move_queue_on(b, workspace);
        }
    }
}

int tile_learner_optimum(const Learner *l, num which)
{
    const Workspace work = workspace_of(l), *const w = &work;
    real wanted[LANES], solved[LANES], broken[LANES];
    num found, more, fine;
    tile_learner_program(l);
    fine = both(which, tile_pivoting_prepare(&w->program));
    found = both(fine, tile_pivoting_round(&w->program, &more));
    copy_where(found, l->candidate, w->program.x, l->d);
    store(wanted, which);
    store(solved, found);
    store(broken, both(fine, more));
    for (int lane = 0; lane < LANES; ++lane) {
        const int actuator = l->number * LANES + lane;
        if (wanted[lane] > 0 && broken[lane] > 0) {
            line_up(l->bank, l->workspace, lane, actuator);
        } else if (wanted[lane] > 0 && !(solved[lane] > 0)) {
            finish(l->bank, l->workspace, &w->program, lane, actuator, 0);
        }
    }
    return 0;
}
