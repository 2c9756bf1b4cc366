/* The exact box solver in C, without Python: minimise 1/2 x'Px + q'x over lb <= x <= ub.
 *
 *     cc -std=c99 -O2 -ffp-contract=off -Isolvers/core examples/c/box_problem.c solvers/core/box_*.c -lm
 *
 * On a controller, -DCORE_VARIABLES=3 makes the size a compile-time constant. All memory is the caller's, aligned for
 * vectors of eight numbers.
 */
#include "box.h"

#include <stdio.h>

enum { D = 3 };

static char memory[1 << 14] __attribute__((aligned(64)));

int main(void)
{
    const real P[D * D] = {4, 1, 0, 1, 2, 1, 0, 1, 3}, q[D] = {-2, -3, 2};
    const real lb[D] = {0, 0, 0}, ub[D] = {INFINITY, 1, INFINITY};
    if (box_bytes(D) > (int64_t)sizeof memory || box_setup(memory, D, lb, ub) != OK) {
        return 1;
    }
    Box box = box_at(memory);
    if (box_set_data(&box, P, q) != OK || box_solve(&box, 0) != OK) {
        return 1;
    }
    for (int j = 0; j < D; ++j) {
        printf("x%d = %.6f, gradient %.6f\n", j, box.answer[j], box_gradient(&box, j));
    }
    return 0;
}
