/* The elementary operators, eight at a time, and the superposition operator.
 *
 *     play          z(k) = max(x(k) - r, min(x(k) + r, z(k-1)))
 *     creep         z(k) = z(k-1) + a (play(x(k-1), r, z(k-1)) - z(k-1)),   a = 1 - exp(-rate Ts)
 *     dead zone     S(u) = max(u - high, 0) + min(u - low, 0)
 *     superposition S[u] = sum of w_i S_i(u)
 *
 * The creep line is the exact solution of dz/dt = rate dz(x - z, r) while x is held. A sample that is NaN leaves play
 * and creep where they are. All amplitudes are unit amplitudes.
 *
 * Source: K. Kuhnen, European Journal of Control 9 (2003) 407-418.
 */
#ifndef CORE_OPERATORS_H
#define CORE_OPERATORS_H

#include "num.h"
#include "shape.h"

#define TINY                                                                                                           \
    ((real)1e-30) /* what fades and is smaller becomes zero, before it is too small for normal numbers, which are      \
                     quick */

CORE_INLINE vec8 play8(vec8 x, vec8 r, vec8 z) { return maximum(sub(x, r), minimum(add(x, r), z)); }

CORE_INLINE vec8 creep8(vec8 x, vec8 r, vec8 a, vec8 z) { return plus_product(z, a, sub(play8(x, r, z), z)); }

CORE_INLINE vec8 dead_zone8(vec8 u, vec8 low, vec8 high)
{
    return add(maximum(sub(u, high), zeros()), minimum(sub(u, low), zeros()));
}

CORE_INLINE vec8 flushed8(vec8 a) { return where_less(splat(TINY), magnitude(a), a, zeros()); }
CORE_INLINE num flushed(num a) { return if_less(constant(TINY), absolute(a), a, constant(0)); }

/* The first that is not larger, not smaller; the first where the second is NaN. */
CORE_INLINE real least(real a, real b) { return b < a ? b : a; }
CORE_INLINE real most(real a, real b) { return b > a ? b : a; }

CORE_INLINE real play_step(real x, real r, real z) { return most(least(z, x + r), x - r); }
CORE_INLINE real creep_step(real x, real r, real a, real z) { return z + a * (play_step(x, r, z) - z); }
CORE_INLINE real dead_zone_step(real u, real low, real high) { return most(0, u - high) + least(0, u - low); }
CORE_INLINE num play_of(num x, num r, num z) { return greatest(lowest(z, plus(x, r)), minus(x, r)); }

typedef struct {
    real *r; /* thresholds of play and creep, lanes */
    real *a; /* gains of creep, one a rate */
} Operators;

typedef struct {
    real *low, *high, *w; /* limits and weights, zone_lanes; padding is -inf, inf and 0 */
} Superposition;

CORE_INLINE Operators operators_at(Arena *arena, Shape s)
{
    Operators p;
    p.r = reals(arena, 1, lanes(s));
    p.a = reals(arena, 1, rate_lanes(s));
    return p;
}

CORE_INLINE int play_vectors(Shape s) { return VECTORS(s.n + 1); }
CORE_INLINE int creep_vectors(Shape s) { return s.rates * VECTORS(s.n + 1); }

/* Move the states on by the sample x that the actuator really saw. */
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

/* The sum of w_i S_i(u). */
CORE_INLINE num superposition(const real *low, const real *high, const num *w, Shape s, num u)
{
    Sum sum = no_sum();
    for (int i = 0; i < VECTORS(s.zones); ++i) {
        accumulate(&sum, i, vector(w, i), dead_zone8(SPREAD(u), PARAMETER(low, i), PARAMETER(high, i)));
    }
    return total(&sum);
}

#endif
