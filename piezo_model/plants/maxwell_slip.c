/* The charge of a chain of springs and sliders along a path of the voltage, as of maxwell_slip.py. */
#include "bindings_model.h"

#include <math.h>

#define NO_ROOM 1e-15 /* rounding errors of the distance to the next slip, and of the path */

typedef struct {
    double spring;       /* the one that does not slide */
    const double *k, *f; /* stiffness of the others, and the force at which each slides */
    double *force;
    int sliders;
} Chain;

/* How far the charge goes before the next slider begins to slide, at most `remaining` in voltage, and the stiffness
 * until then. */
static double distance_to_slip(const Chain *p, double direction, double remaining, double *stiffness)
{
    double distance = INFINITY;
    *stiffness = p->spring;
    for (int j = 0; j < p->sliders; ++j) {
        const double room = (p->f[j] - direction * p->force[j]) / p->k[j];
        if (room > NO_ROOM) {
            *stiffness += p->k[j];
            distance = room < distance ? room : distance;
        }
    }
    return remaining / *stiffness < distance ? remaining / *stiffness : distance;
}

/* The charge after the voltage has moved. */
static double moved(const Chain *p, double q, double move)
{
    const double direction = move > 0 ? 1 : -1;
    double remaining = fabs(move);
    while (remaining > 0) {
        double stiffness;
        const double distance = distance_to_slip(p, direction, remaining, &stiffness);
        for (int j = 0; j < p->sliders; ++j) {
            const double force = p->force[j] + direction * p->k[j] * distance;
            p->force[j] = force > p->f[j] ? p->f[j] : force < -p->f[j] ? -p->f[j] : force;
        }
        q += direction * distance;
        remaining -= stiffness * distance;
        remaining = remaining < NO_ROOM ? 0 : remaining;
    }
    return q;
}

static void charge(const Chain *p, int64_t samples, const double *u, double *q, double *before, double *path)
{
    for (int64_t k = 0; k < samples; ++k) {
        *q = moved(p, *q, u[k] - *before);
        *before = u[k];
        path[k] = *q;
    }
}

#define BINDINGS(F)                                                                                                    \
    F(charge, "u[n], spring, k[j], f[j], force[j]=, q[1]=, u_before[1]=, path[n]=", "charge along u.", SAMPLES_LAST,   \
      charge(&(Chain){NUMBER(1), REALS(2), REALS(3), REALS(4), SIZE(j)}, LENGTH(n), REALS(0), REALS(5), REALS(6),      \
             REALS(7)))
MAKE_BINDINGS(maxwell_slip)
