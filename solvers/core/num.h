/* `num`: a scalar of one actuator, or with CORE_TILE the scalars of a tile of eight actuators, one in each lane.
 *
 * The same source is compiled for both widths and does the same operations in the same order, so that a lane of a tile
 * equals the single actuator to the last bit. Arrays (operators, zones, unknowns) consist of vec8s in both: eight
 * entries of one actuator, or one entry of eight actuators. Conditions are nums, too: 1 or 0.
 */
#ifndef CORE_NUM_H
#define CORE_NUM_H

#include "arena.h"

#ifdef CORE_TILE
typedef vec8 num;
typedef struct {
    vec8 l[LANES];
} Sum;
enum { WIDTH = LANES };
#define N(name) tile_##name
#define VECTORS(count) (count)        /* number of vec8s of an array */
#define NUMS(count) (count)           /* nums to allocate for it */
#define PARAMETER(p, i) splat((p)[i]) /* vec8 i of an array that all actuators share */
#define SPREAD(a) (a)                 /* a num as a vec8 */
CORE_INLINE Sum no_sum(void) { return (Sum){{zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros()}}; }
/* Add the product of the vec8s i of two arrays to their scalar product, which `total` returns, summed as by sum8. */
CORE_INLINE void accumulate(Sum *s, int i, vec8 a, vec8 b) { s->l[i % LANES] = plus_product(s->l[i % LANES], a, b); }
CORE_INLINE num total(const Sum *s)
{
    const vec8 *const l = s->l;
    return add(add(add(l[0], l[4]), add(l[2], l[6])), add(add(l[1], l[5]), add(l[3], l[7])));
}
/* The scalar product of two arrays, in the same order. */
CORE_INLINE num dot(const vec8 *a, const vec8 *b, int count)
{
    Sum sum = no_sum();
    for (int i = 0; i < count; i += LANES) {
        for (int l = 0; l < LANES; ++l) { /* unrolled, so that the sums stay in registers */
            sum.l[l] = i + l < count ? plus_product(sum.l[l], a[i + l], b[i + l]) : sum.l[l];
        }
    }
    return total(&sum);
}
CORE_INLINE num constant(real a) { return splat(a); }
CORE_INLINE num plus(num a, num b) { return add(a, b); }
CORE_INLINE num minus(num a, num b) { return sub(a, b); }
CORE_INLINE num times(num a, num b) { return mul(a, b); }
CORE_INLINE num divided(num a, num b) { return divide(a, b); }
CORE_INLINE num plus_times(num c, num a, num b) { return plus_product(c, a, b); }
CORE_INLINE num minus_times(num c, num a, num b) { return sub_mul(c, a, b); }
CORE_INLINE num greatest(num a, num b) { return maximum(a, b); } /* b if either is NaN */
CORE_INLINE num lowest(num a, num b) { return minimum(a, b); }
CORE_INLINE num absolute(num a) { return magnitude(a); }
CORE_INLINE num if_less(num a, num b, num x, num y) { return where_less(a, b, x, y); }
CORE_INLINE int any(num a) { return largest8(a) > 0; }
#else
typedef real num;
typedef vec8 Sum;
enum { WIDTH = 1 };
#define N(name) name
#define VECTORS(count) (((count) + LANES - 1) / LANES)
#define NUMS(count) padded(count)
#define PARAMETER(p, i) load((p) + LANES * (i))
#define SPREAD(a) splat(a)
CORE_INLINE Sum no_sum(void) { return zeros(); }
CORE_INLINE void accumulate(Sum *s, int i, vec8 a, vec8 b)
{
    (void)i;
    *s = plus_product(*s, a, b);
}
CORE_INLINE num total(const Sum *s) { return sum8(*s); }
CORE_INLINE num dot(const real *a, const real *b, int vectors)
{
    vec8 sum = zeros();
    for (int i = 0; i < LANES * vectors; i += LANES) {
        sum = plus_product(sum, load(a + i), load(b + i));
    }
    return sum8(sum);
}
CORE_INLINE num constant(real a) { return a; }
CORE_INLINE num plus(num a, num b) { return a + b; }
CORE_INLINE num minus(num a, num b) { return a - b; }
CORE_INLINE num times(num a, num b) { return a * b; }
CORE_INLINE num divided(num a, num b) { return a / b; }
CORE_INLINE num plus_times(num c, num a, num b) { return c + a * b; }
CORE_INLINE num minus_times(num c, num a, num b) { return c - a * b; }
CORE_INLINE num greatest(num a, num b) { return a > b ? a : b; }
CORE_INLINE num lowest(num a, num b) { return a < b ? a : b; }
CORE_INLINE num absolute(num a) { return greatest(a, 0 - a); }
CORE_INLINE num if_less(num a, num b, num x, num y) { return a < b ? x : y; }
CORE_INLINE int any(num a) { return a > 0; }
#endif

/* Entries 8 i to 8 i + 7 of one actuator, or entry i of eight actuators. */
CORE_INLINE vec8 vector(const num *p, int i) { return load((const real *)p + LANES * i); }
CORE_INLINE void set_vector(num *p, int i, vec8 a) { store((real *)p + LANES * i, a); }

CORE_INLINE num less(num a, num b) { return if_less(a, b, constant(1), constant(0)); }
CORE_INLINE num is_not(num a) { return minus(constant(1), a); }
CORE_INLINE num logical_and(num a, num b) { return times(a, b); }
CORE_INLINE num logical_or(num a, num b) { return greatest(a, b); }
CORE_INLINE num differs(num a, num b) { return logical_or(less(a, b), less(b, a)); }
CORE_INLINE num where(num which, num a, num b) { return if_less(constant(0), which, a, b); }
CORE_INLINE num is_finite(num a) { return less(absolute(a), constant(REAL_INFINITY)); }
CORE_INLINE num within(num a, num low, num high) { return greatest(lowest(a, high), low); }

CORE_INLINE num *nums(Arena *arena, int count) { return (num *)(void *)reals(arena, count, WIDTH); }

/* One lane of entry i of a vector of nums. */
CORE_INLINE real *entry(const num *vector_of_nums, int i, int lane)
{
    return (real *)(uintptr_t)(vector_of_nums + i) + lane;
}

/* Change *to in the lanes in which `which` is 1. */
CORE_INLINE void set_where(num which, num *to, num a) { *to = where(which, a, *to); }
CORE_INLINE void copy_where(num which, num *to, const num *from, int count)
{
    for (int i = 0; i < count; ++i) {
        set_where(which, to + i, from[i]);
    }
}

/* Storage of the upper triangle of a symmetric matrix by rows: offset of column 0 of row i, and total number of nums.
 * For one actuator, rows are whole vec8s and begin at column 0; for a tile, they begin at the diagonal. */
CORE_INLINE int symmetric_row(int order, int i) { return WIDTH == 1 ? i * NUMS(order) : i * (2 * order - i - 1) / 2; }
CORE_INLINE int symmetric_nums(int order) { return WIDTH == 1 ? order * NUMS(order) : order * (order + 1) / 2; }
/* Index of the vec8 of row i that holds its diagonal entry. */
CORE_INLINE int diagonal_vector(int i) { return i * WIDTH / LANES; }

#endif
