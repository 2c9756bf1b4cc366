/* Block principal pivoting for a box, in scaled variables y = x / s with s_i = P_ii^(-1/2), so that A = sPs has a unit
 * diagonal. With F the free variables, y_F solves A_FF y_F = -(b + A y)_F, and y is the minimiser where lo <= y_F <= hi and
 * the gradient g = b + A y points outwards at every bound.
 *
 * Where A_FF is singular to working precision, REGULARISATION is added to the diagonal and the problem solved again and again
 * round its own answer (the proximal point method), which ends at a minimiser of the problem itself.
 */
#include <float.h>
#include <math.h>
#include <stddef.h>

#include "embedded.h"

enum { LOWER = -1, FREE = 0, UPPER = 1, FIXED = 2 };
enum { SOLVED, SINGULAR, UNFINISHED };

#define PATIENCE 5
#define MOST_REFINEMENTS 2
#define MOST_SYSTEMS (50 + 20 * D)
#define MOST_CENTRES (20 + 2 * D)
#define REGULARISATION 1e-11

/* Rows have room for a right-hand side and are padded with zeros to blocks of eight, which compilers turn into vectors. */
enum { BLOCK = 8, LANES = (D + BLOCK) / BLOCK * BLOCK };

static double A[D][LANES], b[LANES], scale[D], lower[D], upper[D], lo[D], hi[D];
static double y[D], g[LANES], linear[LANES];
static int side[D], free_list[D], free_count, systems, status;
/* L D L' of A_FF: the columns of L D as rows of V, the right-hand side behind them, and the rows of L, zero from the diagonal on. */
static double V[D][LANES], L[D][LANES], r[LANES];

void embedded_setup(const double *lb, const double *ub, const double *settings)
{
    (void)settings;
    for (int i = 0; i < D; ++i) {
        lower[i] = lb[i];
        upper[i] = ub[i];
    }
}

void embedded_update(const double *P, const double *q)
{
    double inverse[D];
    for (int i = 0; i < D; ++i) {
        inverse[i] = P[i * D + i] > 0 ? sqrt(P[i * D + i]) : 1;
        scale[i] = 1 / inverse[i];
        b[i] = q[i] * scale[i];
        lo[i] = lower[i] * inverse[i];
        hi[i] = upper[i] * inverse[i];
    }
    for (int i = 0; i < D; ++i) {
        for (int j = 0; j < D; ++j) {
            A[i][j] = P[i * D + j] * scale[i] * scale[j];
        }
    }
}

/* u -= m v in blocks, from the one that holds `first` up to the one before `end`. */
static void subtract(double *u, double m, const double *v, int first, int end)
{
    for (int j = first / BLOCK * BLOCK; j < end; j += BLOCK) {
        for (int k = j; k < j + BLOCK; ++k) {
            u[k] -= m * v[k];
        }
    }
}

static void gradient(double shift)
{
    double sum[LANES];
    for (int i = 0; i < LANES; ++i) {
        sum[i] = linear[i];
    }
    for (int j = 0; j < D; ++j) {
        const double yj = y[j];
        for (int i = 0; i < LANES; ++i) {
            sum[i] += A[j][i] * yj;
        }
    }
    for (int i = 0; i < D; ++i) {
        g[i] = sum[i] + shift * y[i];
    }
}

/* What rounding may leave of an entry of g that is zero. */
static double tolerance(void)
{
    double largest = 0;
    for (int i = 0; i < D; ++i) {
        largest = fmax(largest, fmax(fabs(linear[i]), fabs(y[i])));
    }
    return 4 * D * DBL_EPSILON * largest;
}

/* Also takes the right-hand side -g_F through the forward solve, to r. */
static int factorise(double shift)
{
    const int n = free_count;
    for (int i = 0; i < n; ++i) {
        const double *const row = A[free_list[i]];
        for (int j = 0; j < n; ++j) {
            V[i][j] = row[free_list[j]];
        }
        V[i][i] += shift;
        V[i][n] = -g[free_list[i]];
        for (int j = n + 1; j < LANES; ++j) {
            V[i][j] = 0;
        }
    }
    for (int k = 0; k < n; ++k) {
        const double pivot = V[k][k];
        if (!(pivot > (shift > 0 ? 0 : D * DBL_EPSILON))) {
            return 0;
        }
        const double inverse = 1 / pivot;
        for (int i = k + 1; i < n; ++i) {
            L[i][k] = V[k][i] * inverse;
            subtract(V[i], L[i][k], V[k], i, n + 1);
        }
        r[k] = V[k][n] * inverse;
    }
    return 1;
}

/* Add the Newton step of y_F, which is L^-T r. */
static void move(void)
{
    for (int i = free_count - 1; i > 0; --i) {
        subtract(r, r[i], L[i], 0, i);
    }
    for (int k = 0; k < free_count; ++k) {
        y[free_list[k]] += r[k];
    }
}

/* Another Newton step with the same factor, for what rounding left of g_F. */
static void refine(void)
{
    const int n = free_count;
    for (int k = 0; k < n; ++k) {
        r[k] = -g[free_list[k]];
    }
    for (int k = 0; k < n; ++k) {
        r[k] /= V[k][k];
        for (int j = k + 1; j < n; ++j) {
            r[j] -= V[k][j] * r[k];
        }
    }
    move();
}

/* How many variables want another side, which is written to `wanted`. */
static int judge(int *wanted, double small)
{
    int broken = 0;
    for (int i = 0; i < D; ++i) {
        wanted[i] = side[i];
        if (side[i] == FREE) {
            wanted[i] = y[i] > hi[i] ? UPPER : y[i] < lo[i] ? LOWER : FREE;
        } else if (side[i] != FIXED && side[i] * g[i] > small) {
            wanted[i] = FREE;
        }
        broken += wanted[i] != side[i];
    }
    return broken;
}

static double residual(void)
{
    double largest = 0;
    for (int k = 0; k < free_count; ++k) {
        largest = fmax(largest, fabs(g[free_list[k]]));
    }
    return largest;
}

static int pivot_all(double shift)
{
    int best = D + 1, patience = PATIENCE;
    for (int round = 0; round < MOST_SYSTEMS; ++round) {
        int wanted[D];
        free_count = 0;
        for (int i = 0; i < D; ++i) {
            if (side[i] == FREE) {
                free_list[free_count++] = i;
            } else {
                y[i] = side[i] == UPPER ? hi[i] : lo[i];
            }
        }
        ++systems;
        gradient(shift);
        if (!factorise(shift)) {
            return SINGULAR;
        }
        move();
        gradient(shift);
        int broken = judge(wanted, tolerance());
        for (int refined = 0; broken == 0 && refined < MOST_REFINEMENTS && residual() > 0.125 * tolerance(); ++refined) {
            refine();
            gradient(shift);
            broken = judge(wanted, tolerance());
        }
        if (broken == 0) {
            return SOLVED;
        }
        patience = broken < best ? PATIENCE : patience - 1;
        best = broken < best ? broken : best;
        if (patience >= 0) {
            for (int i = 0; i < D; ++i) {
                side[i] = wanted[i];
            }
        } else {
            /* The last alone: no set of free variables comes back, if not for rounding. */
            int last = D - 1;
            while (wanted[last] == side[last]) {
                --last;
            }
            side[last] = wanted[last];
        }
    }
    return UNFINISHED;
}

static int proximal_point(void)
{
    for (int k = 0; k < MOST_CENTRES; ++k) {
        double centre[D], moved = 0;
        for (int i = 0; i < D; ++i) {
            centre[i] = y[i];
            linear[i] = b[i] - REGULARISATION * y[i];
        }
        const int found = pivot_all(REGULARISATION);
        if (found != SOLVED) {
            return found;
        }
        for (int i = 0; i < D; ++i) {
            moved = fmax(moved, fabs(y[i] - centre[i]));
        }
        if (REGULARISATION * moved <= tolerance()) {
            return SOLVED;
        }
    }
    return UNFINISHED;
}

int embedded_solve(const double *start)
{
    for (int i = 0; i < D; ++i) {
        y[i] = start ? start[i] / scale[i] : 0;
        side[i] = lower[i] >= upper[i] ? FIXED : !start ? FREE : start[i] <= lower[i] ? LOWER : start[i] >= upper[i] ? UPPER : FREE;
        linear[i] = b[i];
    }
    systems = 0;
    status = pivot_all(0);
    if (status == SINGULAR) {
        for (int i = 0; i < D; ++i) {
            y[i] = fmax(lo[i], fmin(hi[i], 0));
        }
        status = proximal_point();
    }
    return status;
}

void embedded_answer(double *x, double *z)
{
    for (int i = 0; i < D; ++i) {
        const double at = side[i] == FREE ? scale[i] * y[i] : side[i] == UPPER ? upper[i] : lower[i];
        x[i] = fmax(lower[i], fmin(upper[i], at));
        z[i] = side[i] == FREE ? 0 : -g[i] / scale[i];
    }
}

const char *embedded_status(void)
{
    return status == SOLVED ? "solved" : status == SINGULAR ? "P is not positive semidefinite" : "not solved";
}

int embedded_iterations(void) { return systems; }
