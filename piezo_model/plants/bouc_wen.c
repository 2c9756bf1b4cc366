/* The Bouc-Wen equation along a path, as of bouc_wen.py. */
#include "bindings_model.h"

#include <math.h>

#define LONGEST_STEP                                                                                                   \
    (1.0 / 1024.0) /* of u in one Runge-Kutta step: the kink of |h|^n at h = 0 costs the method its order there */

typedef struct {
    double A, beta, gamma, n;
} BoucWen;

/* dh/du where u moves in the given direction (1 or -1). */
static double slope(const BoucWen *p, double h, double direction)
{
    const double power = pow(fabs(h), p->n);
    return p->A - p->beta * direction * copysign(power, h) - p->gamma * power;
}

/* h after u has moved, by the classical Runge-Kutta method in u. */
static double moved(const BoucWen *p, double h, double move)
{
    const double direction = copysign(1, move), steps = ceil(fabs(move) / LONGEST_STEP), d = move / steps;
    for (double i = 0; i < steps; ++i) {
        const double s1 = slope(p, h, direction), s2 = slope(p, h + d * s1 / 2, direction);
        const double s3 = slope(p, h + d * s2 / 2, direction), s4 = slope(p, h + d * s3, direction);
        h += d * (s1 + 2 * s2 + 2 * s3 + s4) / 6;
    }
    return h;
}

static void bouc_wen(const BoucWen *p, int64_t samples, const double *u, double *h, double *before, double *path)
{
    for (int64_t k = 0; k < samples; ++k) {
        const double move = u[k] - *before;
        *h = move > 0 || move < 0 ? moved(p, *h, move) : *h;
        *before = u[k];
        path[k] = *h;
    }
}

#define BINDINGS(F)                                                                                                    \
    F(bouc_wen, "u[n], A, beta, gamma, n, h[1]=, u_before[1]=, path[n]=", "h along u.", SAMPLES_LAST,                  \
      bouc_wen(&(BoucWen){NUMBER(1), NUMBER(2), NUMBER(3), NUMBER(4)}, LENGTH(n), REALS(0), REALS(5), REALS(6),        \
               REALS(7)))
MAKE_BINDINGS(bouc_wen)
