/* The elementary operators, eight at a time, and the superposition operator.
 *
 *     play          z(k) = max(x(k) - r, min(x(k) + r, z(k-1)))
 *     creep         z(k) = z(k-1) + a (play(x(k-1), r, z(k-1)) - z(k-1)),   a = 1 - exp(-rate Ts)
 *     dead zone     S(u) = max(u - high, 0) + min(u - low, 0)
 *     superposition S[u] = sum of w_i S_i(u)
 *
 * The creep line is the exact solution of dz/dt = rate dz(x - z, r) while x is held. A NaN sample leaves the
 * states of play and creep unchanged. All amplitudes are in normalised units.
 *
 * Source: K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_OPERATORS_H
#define CORE_OPERATORS_H

#include "num.h"
#include "shape.h"

/* Smallest magnitude of a decaying number; below it is set to zero, before it becomes a slow denormal. */
#define TINY ((real)1e-30)

CORE_INLINE vec8 play8(vec8 x, vec8 r, vec8 z) { return maximum(sub(x, r), minimum(add(x, r), z)); }

CORE_INLINE vec8 creep8(vec8 x, vec8 r, vec8 a, vec8 z) { return plus_product(z, a, sub(play8(x, r, z), z)); }

CORE_INLINE vec8 dead_zone8(vec8 u, vec8 low, vec8 high)
{
    return add(maximum(sub(u, high), zeros()), minimum(sub(u, low), zeros()));
}

CORE_INLINE vec8 flushed8(vec8 a) { return where_less(splat(TINY), magnitude(a), a, zeros()); }
CORE_INLINE num flushed(num a) { return if_less(constant(TINY), absolute(a), a, constant(0)); }

/* One operator of each actuator. */
CORE_INLINE num play_of(num x, num r, num z) { return greatest(minus(x, r), lowest(plus(x, r), z)); }
CORE_INLINE num creep_of(num x, num r, num a, num z) { return plus_times(z, a, minus(play_of(x, r, z), z)); }

typedef struct {
    real *r; /* thresholds of play and creep, lanes */
    real *a; /* gains of creep, one for each rate */
} Operators;

CORE_INLINE Operators operators_at(Arena *arena, Shape s)
{
    Operators p;
    p.r = reals(arena, 1, lanes(s));
    p.a = reals(arena, 1, rate_lanes(s));
    return p;
}

CORE_INLINE int play_vectors(Shape s) { return VECTORS(s.n + 1); }
CORE_INLINE int creep_vectors(Shape s) { return s.rates * VECTORS(s.n + 1); }

/* Advance the states by one sample x of the actuator's input. */
CORE_INLINE void advance(Operators p, Shape s, num x, num *play, num *creep)
{
    const vec8 input = SPREAD(x);
    const int k = play_vectors(s);
    for (int i = 0; i < k; ++i) {
        const vec8 r = PARAMETER(p.r, i);
        set_vector(play, i, play8(input, r, vector(play, i)));
        for (int j = 0; j < s.rates; ++j) {
            set_vector(creep, j * k + i, creep8(input, r, splat(p.a[j]), vector(creep, j * k + i)));
        }
    }
}

enum { CREEP_VECTORS = sizeof(real) == 4 ? 2 : 1 }; /* of creep states, with the remainders in single precision */

/* Advance the states by the drive x that the actuator receives. */
CORE_INLINE void receive(Operators p, Shape s, num x, num *play, num *creep)
{
#ifdef CORE_FLOAT
    /* Slow creep moves by less than the rounding of a float, so the remainder is carried. */
    for (int j = 0; j < creep_lanes(s); ++j) {
        real *const z = creep + j, *const rest = z + creep_lanes(s), before = *z;
        const real change = p.a[j / lanes(s)] * (play_of(x, p.r[j % lanes(s)], before) - before) + *rest;
        *z = before + change;
        *rest = change - (*z - before);
    }
    for (int i = 0; i < lanes(s); ++i) {
        play[i] = play_of(x, p.r[i], play[i]);
    }
#else
    advance(p, s, x, play, creep);
#endif
}

/* The sum of w_i S_i(u) over zone_lanes limits and weights; padding has the limits -inf and inf and the weight 0. */
CORE_INLINE num superposition(const real *low, const real *high, const num *w, Shape s, num u)
{
    Sum sum = no_sum();
    for (int i = 0; i < VECTORS(s.zones); ++i) {
        accumulate(&sum, i, vector(w, i), dead_zone8(SPREAD(u), PARAMETER(low, i), PARAMETER(high, i)));
    }
    return total(&sum);
}

#endif
