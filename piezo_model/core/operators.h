/* The elementary operators, eight at a time, and the superposition operator.
 *
 *     play          z(k) = max(x(k) - r, min(x(k) + r, z(k-1)))
 *     creep         z(k) = z(k-1) + a (play(x(k-1), r, z(k-1)) - z(k-1)),   a = 1 - exp(-rate Ts)
 *     dead zone     S(u) = max(u - high, 0) + min(u - low, 0)
 *     superposition S[u] = sum of w_i S_i(u)
 *
 * The creep line is the exact solution of dz/dt = rate dz(x - z, r) while x is held. A sample that is NaN leaves play and creep where
 * they are. All amplitudes are unit amplitudes.
 *
 * Source: K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_OPERATORS_H
#define CORE_OPERATORS_H

#include "shape.h"

CORE_INLINE vec8 play8(vec8 x, vec8 r, vec8 z) { return larger(sub(x, r), smaller(add(x, r), z)); }

CORE_INLINE vec8 creep8(vec8 x, vec8 r, vec8 a, vec8 z) { return plus_product(z, a, sub(play8(x, r, z), z)); }

CORE_INLINE vec8 dead_zone8(vec8 u, vec8 low, vec8 high)
{
    return add(larger(sub(u, high), zeros()), smaller(sub(u, low), zeros()));
}

/* The first that is not larger, not smaller; the first where the second is NaN. */
CORE_INLINE real least(real a, real b) { return b < a ? b : a; }
CORE_INLINE real most(real a, real b) { return b > a ? b : a; }

CORE_INLINE real play_step(real x, real r, real z) { return most(least(z, x + r), x - r); }
CORE_INLINE real creep_step(real x, real r, real a, real z) { return z + a * (play_step(x, r, z) - z); }
CORE_INLINE real dead_zone_step(real u, real low, real high) { return most(0, u - high) + least(0, u - low); }

typedef struct {
    real *r; /* thresholds of play and creep, lanes */
    real *a; /* gains of creep, creep_lanes */
} Operators;

typedef struct {
    real *low, *high, *w; /* limits and weights, zone_lanes; padding is -inf, inf and 0 */
} Superposition;

CORE_INLINE Operators take_operators(Room *room, Shape s)
{
    Operators p;
    p.r = reals(room, 1, lanes(s));
    p.a = reals(room, s.rates, lanes(s));
    return p;
}

CORE_INLINE Superposition take_superposition(Room *room, Shape s)
{
    Superposition p;
    p.low = reals(room, 1, zone_lanes(s));
    p.high = reals(room, 1, zone_lanes(s));
    p.w = reals(room, 1, zone_lanes(s));
    return p;
}

/* Move the states play (lanes) and creep (creep_lanes) on by the sample x that the actuator really saw. */
CORE_INLINE void advance(Operators p, Shape s, real x, real *play, real *creep)
{
    const vec8 input = splat(x);
    for (int i = 0; i < lanes(s); i += LANES) {
        const vec8 r = load(p.r + i);
        store(play + i, play8(input, r, load(play + i)));
        for (int j = i; j < creep_lanes(s); j += lanes(s)) {
            store(creep + j, creep8(input, r, load(p.a + j), load(creep + j)));
        }
    }
}

/* The sum of w_i z_i over so many lanes. */
CORE_INLINE real weighted_sum(const real *w, const real *z, int count)
{
    vec8 total = zeros();
    for (int i = 0; i < count; i += LANES) {
        total = plus_product(total, load(w + i), load(z + i));
    }
    return sum8(total);
}

CORE_INLINE real superposition(Superposition p, Shape s, real u)
{
    vec8 total = zeros();
    for (int i = 0; i < zone_lanes(s); i += LANES) {
        total = plus_product(total, load(p.w + i), dead_zone8(splat(u), load(p.low + i), load(p.high + i)));
    }
    return sum8(total);
}

#endif
