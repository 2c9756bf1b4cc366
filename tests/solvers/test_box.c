/* Tests of the exact box solver, see box.h; they need a C compiler alone:
 *
 *     cc -std=c99 -O2 -ffp-contract=off -Isolvers/core tests/solvers/test_box.c solvers/core/box_*.c -lm
 *
 * The program prints each condition that does not hold, and ends with their number.
 */
#include "box.h"

#include <stdio.h>

enum { MOST = 40 };

static real P[MOST * MOST], q[MOST], lb[MOST], ub[MOST], x[MOST];
static char memory[1 << 17] __attribute__((aligned(64)));
static int failures;

#define CHECK(condition) check(condition, #condition, __LINE__)
static void check(int holds, const char *condition, int line)
{
    if (!holds) {
        printf("line %d: %s\n", line, condition);
        ++failures;
    }
}

/* Pseudorandom numbers in [-1, 1). */
static real random_real(void)
{
    static uint64_t state = 1;
    state = state * 6364136223846793005U + 1442695040888963407U;
    return (real)(int32_t)(state >> 32) / (real)2147483648.0;
}

/* P = A'A + I/10 for a random A; bounds of every kind. */
static void draw(int d)
{
    real A[MOST * MOST];
    for (int i = 0; i < d * d; ++i) {
        A[i] = random_real();
    }
    for (int i = 0; i < d; ++i) {
        const int kind = (int)(2 + 2 * random_real());
        q[i] = 2 * random_real();
        lb[i] = kind == 0 ? -INFINITY : kind == 1 ? 0 : -(real)0.1;
        ub[i] = kind == 2 ? (real)0.1 : kind == 3 ? lb[i] : INFINITY;
        for (int j = 0; j < d; ++j) {
            P[i * d + j] = i == j ? (real)0.1 : 0;
            for (int k = 0; k < d; ++k) {
                P[i * d + j] += A[k * d + i] * A[k * d + j];
            }
        }
    }
}

static int solve(int d)
{
    box_setup(memory, d, lb, ub);
    Box s = box_at(memory);
    box_set_data(&s, P, q);
    const int status = box_solve(&s, 0);
    memcpy(x, s.answer, (size_t)d * sizeof(real));
    return status;
}

/* The answer is in its bounds, and its gradient is zero or holds a bound. */
static void check_optimum(int d)
{
    for (int i = 0; i < d; ++i) {
        real g = q[i];
        for (int j = 0; j < d; ++j) {
            g += P[i * d + j] * x[j];
        }
        CHECK(lb[i] <= x[i] && x[i] <= ub[i]);
        CHECK(g > -1e-12 || x[i] == ub[i]);
        CHECK(g < 1e-12 || x[i] == lb[i]);
    }
}

static void test_random_programs(void)
{
    for (int d = 1; d <= MOST; ++d) {
        draw(d);
        CHECK(solve(d) == OK);
        check_optimum(d);
    }
}

/* A power of two times P and q changes no bit. */
static void test_scales(void)
{
    real before[MOST];
    draw(9);
    solve(9);
    memcpy(before, x, sizeof before);
    for (int i = 0; i < 81; ++i) {
        P[i] *= 1024;
        q[i % 9] *= i < 9 ? 1024 : 1;
    }
    CHECK(solve(9) == OK);
    CHECK(memcmp(before, x, 9 * sizeof(real)) == 0);
}

/* What is no convex program is refused. */
static void test_refusals(void)
{
    draw(4);
    P[5] = -1;
    CHECK(solve(4) == INDEFINITE);
    draw(4);
    P[1] += 1;
    CHECK(solve(4) == ASYMMETRIC);
    draw(4);
    q[2] = NAN;
    CHECK(solve(4) == NOT_FINITE);
    draw(4);
    lb[1] = 1;
    ub[1] = 0;
    CHECK(solve(4) == CROSSED);
}

/* A variable without curvature goes to the bound that q points to, or nowhere. */
static void test_zero_row(void)
{
    P[0] = 2;
    P[1] = P[2] = P[3] = 0;
    q[0] = q[1] = -1;
    lb[0] = lb[1] = 0;
    ub[0] = ub[1] = 3;
    CHECK(solve(2) == OK);
    CHECK(x[0] == (real)0.5 && x[1] == 3);
    ub[1] = INFINITY;
    CHECK(solve(2) == UNBOUNDED);
}

int main(void)
{
    test_random_programs();
    test_scales();
    test_refusals();
    test_zero_row();
    return failures;
}
