/* Rows (Xi, x) of the error model (5) for the samples of a block, and their Gram matrix
 *
 *     G <- lambda G + w row row',
 *
 * sample by sample, where bad samples have rows of zeros and do not count. The sums of a block are those of its good
 * samples.
 */
#ifndef CORE_ROWS_H
#define CORE_ROWS_H

#include "learner.h"

/* Count the good samples of a block. */
CORE_INLINE BlockSummary count_good(const Block *block)
{
    BlockSummary b = {.count = block->head->count, .end = block->head->first + block->head->count};
    for (int k = 0; k < b.count; ++k) {
        b.good = plus(b.good, is_finite(from_shared(block->y, k)));
    }
    return b;
}

/* Write the rows of a block and sum it up; with `judges`, compute the errors of the weights in use and the candidate.
 */
CORE_INLINE BlockSummary write_rows(const Learner *l, const Block *block, int judges)
{
    const Shape s = l->shape;
    const Workspace work = workspace_of(l), *const w = &work;
    BlockSummary b = count_good(block);
    span_clear(b.span, SPAN, constant(1));
    for (int i = 0; i < state_nums(s); ++i) { /* play, then creep */
        w->play[i] = from_shared(block->play, i);
    }
    for (int k = 0; k < b.count; ++k) {
        num *const row = w->rows + k * row_nums(s);
        const num x = from_shared(block->x, k), y = from_shared(block->y, k), good = is_finite(y);
        write_row(&l->regressors, s, good, x, where(good, y, constant(0)), w->play, w->creep, row);
        span_widen(b.span, (const num[]){x, x, y, y}, good);
    }
    if (judges) {
        N(noise_judge)(l, block, &b);
    }
    return b;
}

/* Add the rows to the Gram matrix where it `learns`. */
CORE_INLINE void add_rows(const Learner *l, int count, num learns)
{
    const LearnerSettings *const p = l->settings;
    const int stride = row_nums(l->shape);
    num *const rows = workspace_of(l).rows + 1;
    const num forgetting = constant(p->forgetting), root_step = constant(ROOT(p->forgetting));
    const Block block = block_at(&l->mailbox, l->mailbox.head->consumed);
    num root = times(learns, constant(ROOT(p->row_weight))), fade = constant(1);
    /* The newest row has the full weight. */
    for (int k = count - 1; k >= 0 && (p->forgetting < 1 || p->row_weight < 1); --k) {
        num *const row = rows + k * stride;
        const num counts = logical_and(learns, is_finite(from_shared(block.y, k)));
        const vec8 weight = SPREAD(root);
        for (int i = 0; i < VECTORS(l->d + 1); ++i) {
            set_vector(row, i, mul(weight, vector(row, i)));
        }
        root = where(counts, times(root, root_step), root);
        fade = where(counts, times(fade, forgetting), fade);
    }
    gram_add(l->gram, l->d + 1, fade, rows, stride, count);
}

#endif
