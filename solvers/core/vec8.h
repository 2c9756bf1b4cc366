/* Vectors of eight numbers, with the same bits on every instruction set and compiler.
 *
 * A vec8 is eight lanes in as many registers as the machine needs: one of AVX-512, two of AVX, four of SSE2 or NEON, or
 * eight plain numbers if the compiler has no vector types. Every function works lane by lane with one rounding per
 * operation; no product is fused with a sum (compile with -ffp-contract=off). The only sum across lanes is sum8, which
 * adds halves:
 *
 *     ((l0 + l4) + (l2 + l6)) + ((l1 + l5) + (l3 + l7)).
 *
 * Comparisons with NaN are false: maximum(a, b) = a > b ? a : b, so a NaN on either side gives b.
 *
 * `real` is double, or float with -DCORE_FLOAT; -DCORE_PLAIN selects plain numbers.
 */
#ifndef CORE_VEC8_H
#define CORE_VEC8_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef CORE_FLOAT
typedef float real;
typedef int32_t whole; /* as wide as a real */
#define REAL_EPSILON 1.1920928955078125e-07F
#define MANTISSA_BITS 23
#define EXPONENT_BIAS 127
#define ROOT(x) sqrtf(x)
#define MAGNITUDE(x) fabsf(x)
#else
typedef double real;
typedef int64_t whole;
#define REAL_EPSILON 2.220446049250313e-16
#define MANTISSA_BITS 52
#define EXPONENT_BIAS 1023
#define ROOT(x) sqrt(x)
#define MAGNITUDE(x) fabs(x)
#endif
#define REAL_INFINITY ((real)INFINITY)

#if defined(__GNUC__)
#define CORE_INLINE static inline __attribute__((always_inline, unused))
#else
#define CORE_INLINE static inline
#endif

/* An exported folder compiles all files as one unit with static functions: -DCORE_API="static ...". */
#ifndef CORE_API
#define CORE_API
#endif

enum { LANES = 8 };

/* `reg` is one register. REGISTERS is a macro, since the preprocessor tests it. */
#if !defined(__GNUC__) || defined(CORE_PLAIN)
#define REGISTERS 8
typedef real reg;
typedef whole reg_bits;
#else
#if defined(__AVX512F__) && !defined(CORE_FLOAT)
#define REGISTER_BYTES 64
#define REGISTERS 1
#elif defined(__AVX__)
#define REGISTER_BYTES 32
#ifdef CORE_FLOAT
#define REGISTERS 1
#else
#define REGISTERS 2
#endif
#else
#define REGISTER_BYTES 16
#ifdef CORE_FLOAT
#define REGISTERS 2
#else
#define REGISTERS 4
#endif
#endif
typedef real reg __attribute__((vector_size(REGISTER_BYTES)));
typedef whole reg_bits __attribute__((vector_size(REGISTER_BYTES)));
#if defined(__SSE2__)
#include <immintrin.h>
#endif
#endif
enum { REGISTER_LANES = LANES / REGISTERS };

/* Members by name and not an array, so that compilers keep them in registers. ALL(f) is f of each register and its
 * number.
 */
#if REGISTERS == 1
typedef struct {
    reg p0;
} vec8;
#define ALL(f) {f(p0, 0)}
#define SPLAT(s) {s, s, s, s, s, s, s, s}
#define COUNT(i) {i, (i) + 1, (i) + 2, (i) + 3, (i) + 4, (i) + 5, (i) + 6, (i) + 7}
#elif REGISTERS == 2
typedef struct {
    reg p0, p1;
} vec8;
#define ALL(f) {f(p0, 0), f(p1, 1)}
#define SPLAT(s) {s, s, s, s}
#define COUNT(i) {i, (i) + 1, (i) + 2, (i) + 3}
#elif REGISTERS == 4
typedef struct {
    reg p0, p1, p2, p3;
} vec8;
#define ALL(f) {f(p0, 0), f(p1, 1), f(p2, 2), f(p3, 3)}
#define SPLAT(s) {s, s}
#define COUNT(i) {i, (i) + 1}
#else
typedef struct {
    reg p0, p1, p2, p3, p4, p5, p6, p7;
} vec8;
#define ALL(f) {f(p0, 0), f(p1, 1), f(p2, 2), f(p3, 3), f(p4, 4), f(p5, 5), f(p6, 6), f(p7, 7)}
#define SPLAT(s) s
#define COUNT(i) i
#endif

CORE_INLINE reg load_reg(const real *p)
{
    reg r;
    memcpy(&r, p, sizeof r);
    return r;
}
CORE_INLINE void store_reg(real *p, reg a) { memcpy(p, &a, sizeof a); }
CORE_INLINE reg splat_reg(real s) { return (reg)SPLAT(s); }
CORE_INLINE reg_bits splat_bits(whole s) { return (reg_bits)SPLAT(s); }
CORE_INLINE reg_bits numbers_from(whole i) { return (reg_bits)COUNT(i); }
CORE_INLINE reg_bits bits_of(reg a)
{
    reg_bits r;
    memcpy(&r, &a, sizeof r);
    return r;
}
CORE_INLINE reg reg_of(reg_bits a)
{
    reg r;
    memcpy(&r, &a, sizeof r);
    return r;
}

#if REGISTERS == 8
#define CHOOSE(condition, a, b) ((condition) ? (a) : (b))
#else
#define CHOOSE(condition, a, b) reg_of((bits_of(a) & (condition)) | (bits_of(b) & ~(condition)))
#endif

CORE_INLINE reg maximum_reg(reg a, reg b)
{
#if REGISTERS == 1 && !defined(CORE_FLOAT)
    return (reg)_mm512_max_pd((__m512d)a, (__m512d)b);
#elif REGISTERS == 2 && defined(__AVX__) && !defined(CORE_FLOAT)
    return (reg)_mm256_max_pd((__m256d)a, (__m256d)b);
#elif REGISTERS == 4 && defined(__SSE2__)
    return (reg)_mm_max_pd((__m128d)a, (__m128d)b);
#else
    return CHOOSE(a > b, a, b);
#endif
}

CORE_INLINE reg minimum_reg(reg a, reg b)
{
#if REGISTERS == 1 && !defined(CORE_FLOAT)
    return (reg)_mm512_min_pd((__m512d)a, (__m512d)b);
#elif REGISTERS == 2 && defined(__AVX__) && !defined(CORE_FLOAT)
    return (reg)_mm256_min_pd((__m256d)a, (__m256d)b);
#elif REGISTERS == 4 && defined(__SSE2__)
    return (reg)_mm_min_pd((__m128d)a, (__m128d)b);
#else
    return CHOOSE(a < b, a, b);
#endif
}

/* 2^-floor(e / 2) for v = m 2^e with m in [1/2, 1); undefined unless v is a positive normal number. */
CORE_INLINE reg root_scale_reg(reg v)
{
    const reg_bits exponent = (bits_of(v) >> MANTISSA_BITS) - splat_bits(EXPONENT_BIAS - 1);
    return reg_of((splat_bits(EXPONENT_BIAS) - (exponent >> 1)) << MANTISSA_BITS);
}

CORE_INLINE reg magnitude_reg(reg a)
{
#if REGISTERS == 8
    return MAGNITUDE(a);
#else
    return reg_of(bits_of(a) & ~bits_of(splat_reg((real)-0.0)));
#endif
}

#define ONE_OF(p, i) load_reg(source + (i) * REGISTER_LANES)
CORE_INLINE vec8 load(const real *source) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) every
CORE_INLINE vec8 splat(real s)
{
    const reg every = splat_reg(s);
    return (vec8)ALL(ONE_OF);
}
#undef ONE_OF
/* Lane k is source[min(k, last) stride]: a diagonal or a column, without a detour over memory. */
#define AT(k) source[(size_t)((k) < last ? (k) : last) * stride]
#if REGISTERS == 1
#define FROM(i) {AT(i), AT(i + 1), AT(i + 2), AT(i + 3), AT(i + 4), AT(i + 5), AT(i + 6), AT(i + 7)}
#elif REGISTERS == 2
#define FROM(i) {AT(i), AT(i + 1), AT(i + 2), AT(i + 3)}
#elif REGISTERS == 4
#define FROM(i) {AT(i), AT(i + 1)}
#else
#define FROM(i) AT(i)
#endif
#define ONE_OF(p, i) (reg) FROM((i) * REGISTER_LANES)
CORE_INLINE vec8 load_strided(const real *source, size_t stride, int last) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#undef FROM
#undef AT
#define ONE_OF(p, i) a.p + b.p
CORE_INLINE vec8 add(vec8 a, vec8 b) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) a.p - b.p
CORE_INLINE vec8 sub(vec8 a, vec8 b) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) a.p *b.p
CORE_INLINE vec8 mul(vec8 a, vec8 b) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) a.p / b.p
CORE_INLINE vec8 divide(vec8 a, vec8 b) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) maximum_reg(a.p, b.p)
CORE_INLINE vec8 maximum(vec8 a, vec8 b) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) minimum_reg(a.p, b.p)
CORE_INLINE vec8 minimum(vec8 a, vec8 b) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) CHOOSE(a.p < b.p, x.p, y.p)
/* Lane by lane x if a < b, else y; y if either is NaN. */
CORE_INLINE vec8 where_less(vec8 a, vec8 b, vec8 x, vec8 y) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
#define ONE_OF(p, i) root_scale_reg(a.p)
CORE_INLINE vec8 root_scale(vec8 a) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
/* a with `number` in lane `place`; a if there is no such lane. */
#define ONE_OF(p, i) CHOOSE(numbers_from((i) * REGISTER_LANES) == at, number_everywhere, a.p)
CORE_INLINE vec8 with_lane(vec8 a, int place, real number)
{
    const reg_bits at = splat_bits(place);
    const reg number_everywhere = splat_reg(number);
    return (vec8)ALL(ONE_OF);
}
#undef ONE_OF

#define ONE_OF(p, i) (store_reg(target + (i) * REGISTER_LANES, a.p), 0)
CORE_INLINE void store(real *target, vec8 a)
{
    const int done[REGISTERS] = ALL(ONE_OF);
    (void)done;
}
#undef ONE_OF

/* The first `count` (1 to 8) numbers, and zeros in the other lanes; memory beyond `count` is not read. */
CORE_INLINE vec8 load_first(const real *source, int count)
{
#if REGISTERS == 1 && defined(__AVX512F__) && !defined(CORE_FLOAT)
    return (vec8){(reg)_mm512_maskz_loadu_pd((__mmask8)((1U << count) - 1U), source)};
#elif REGISTERS == 2 && defined(__AVX2__) && !defined(CORE_FLOAT)
    const reg_bits end = splat_bits(count);
    return (vec8){(reg)_mm256_maskload_pd(source, (__m256i)(numbers_from(0) < end)),
                  (reg)_mm256_maskload_pd(source + 4, (__m256i)(numbers_from(4) < end))};
#else
    real l[LANES] = {0};
    for (int i = 0; i < count; ++i) {
        l[i] = source[i];
    }
    return load(l);
#endif
}

CORE_INLINE vec8 zeros(void) { return splat((real)0); }
/* c + a b and c - a b, the product rounded first. */
CORE_INLINE vec8 plus_product(vec8 c, vec8 a, vec8 b) { return add(c, mul(a, b)); }
CORE_INLINE vec8 sub_mul(vec8 c, vec8 a, vec8 b) { return sub(c, mul(a, b)); }
#define ONE_OF(p, i) magnitude_reg(a.p)
CORE_INLINE vec8 magnitude(vec8 a) { return (vec8)ALL(ONE_OF); }
#undef ONE_OF
CORE_INLINE vec8 clip(vec8 a, vec8 lower, vec8 upper) { return minimum(maximum(a, lower), upper); }

/* Reduce eight lanes to two by the operation `onto`: even lanes to the first, odd lanes to the second. */
#if REGISTERS == 1 && !defined(CORE_FLOAT)
#define FOLD(onto4, onto2, onto_reg)                                                                                   \
    const __m256d half = onto4(_mm512_castpd512_pd256((__m512d)a.p0), _mm512_extractf64x4_pd((__m512d)a.p0, 1));       \
    const __m128d two = onto2(_mm256_castpd256_pd128(half), _mm256_extractf128_pd(half, 1));
#elif REGISTERS == 2 && defined(__AVX__) && !defined(CORE_FLOAT)
#define FOLD(onto4, onto2, onto_reg)                                                                                   \
    const __m256d half = onto4((__m256d)a.p0, (__m256d)a.p1);                                                          \
    const __m128d two = onto2(_mm256_castpd256_pd128(half), _mm256_extractf128_pd(half, 1));
#elif REGISTERS == 4
#define FOLD(onto4, onto2, onto_reg) const reg two = onto_reg(onto_reg(a.p0, a.p2), onto_reg(a.p1, a.p3));
#else
#define FOLD(onto4, onto2, onto_reg)                                                                                   \
    real l[LANES];                                                                                                     \
    store(l, a);                                                                                                       \
    const real two[2] = {onto_reg(onto_reg(l[0], l[4]), onto_reg(l[2], l[6])),                                         \
                         onto_reg(onto_reg(l[1], l[5]), onto_reg(l[3], l[7]))};
#endif

#define PLUS(a, b) ((a) + (b))
CORE_INLINE real sum8(vec8 a)
{
    FOLD(_mm256_add_pd, _mm_add_pd, PLUS)
    return two[0] + two[1];
}
#undef PLUS

#if REGISTERS == 4
#define LARGER(a, b) maximum_reg(a, b)
#else
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#endif
CORE_INLINE real largest8(vec8 a)
{
    FOLD(_mm256_max_pd, _mm_max_pd, LARGER)
    return two[0] > two[1] ? two[0] : two[1];
}
#undef LARGER
#undef FOLD

/* The largest |entry| of a vector of ld entries. */
CORE_INLINE real largest_entry(const real *a, int ld)
{
    vec8 most = zeros();
    for (int b = 0; b < ld; b += LANES) {
        most = maximum(most, magnitude(load(a + b)));
    }
    return largest8(most);
}

/* Whether no number is NaN or infinite, which differ from themselves by NaN. */
CORE_INLINE int are_finite(const real *x, int64_t count)
{
    vec8 nothing = zeros();
    for (int64_t b = 0; b < count; b += LANES) {
        const vec8 some = b + LANES <= count ? load(x + b) : load_first(x + b, (int)(count - b));
        nothing = add(nothing, sub(some, some));
    }
    return sum8(nothing) == 0;
}

/* The first lane that equals `number`, or 8. */
CORE_INLINE int first_equal8(vec8 a, real number)
{
#if REGISTERS == 1 && defined(__AVX512F__) && !defined(CORE_FLOAT)
    return __builtin_ctz(0x100U | _mm512_cmp_pd_mask((__m512d)a.p0, _mm512_set1_pd(number), _CMP_EQ_OQ));
#else
    real l[LANES];
    int place = 0;
    store(l, a);
    while (place < LANES && !(l[place] == number)) {
        ++place;
    }
    return place;
#endif
}

/* Prefetch memory into the first-level cache, if the compiler supports it. A function that does nothing else must be
 * inline, or gcc drops calls of it as having no effect. */
CORE_INLINE void fetch(const void *memory, int64_t bytes)
{
#if defined(__GNUC__)
    for (int64_t i = 0; i < bytes; i += 64) {
        __builtin_prefetch((const char *)memory + i);
    }
#else
    (void)memory;
    (void)bytes;
#endif
}

/* The power of two below v > 0, at least the smallest normal number. */
CORE_INLINE real power_below(real v)
{
    whole bits;
    memcpy(&bits, &v, sizeof bits);
    bits = bits >> MANTISSA_BITS == 0 ? (whole)1 << MANTISSA_BITS : bits >> MANTISSA_BITS << MANTISSA_BITS;
    memcpy(&v, &bits, sizeof v);
    return v;
}

/* n rounded up to whole blocks of eight. */
CORE_INLINE int padded(int n) { return (n + LANES - 1) / LANES * LANES; }

#endif
