/* A guess of which variables F are free and which A sit at a bound leaves one candidate, x_A at its bounds and
 *
 *     P_FF x_F = -(q_F + P_FA x_A).
 *
 * It is the minimiser iff lb <= x_F <= ub and the gradient g = q + P x holds every bound: g >= 0 at a lower, g <= 0 at
 * an upper one. Each round exchanges all variables that break this (Judice & Pires, Computers & Operations Research 21
 * (1994) 587). The system is solved for the step from the x of the round before, so that a round on the same sides is
 * one of iterative refinement. Programs that are solved side by side differ in F and share every instruction: what a
 * program leaves out takes part with zeros (factor.h).
 *
 * A first guess is what one sweep of coordinate descent leaves free. On programs of this project it halves the rounds
 * that "all free" takes (at d = 18 from 6.5 to 3.6, at d = 60 from 15 to 7), for less than the price of one.
 *
 * Tolerances are in the variables z = x / S with S P S of unit diagonal up to a factor of two: the rounding of S g is
 * about d eps max(|z|, |S q|). A multiplier within it counts as zero, which keeps ties from cycling; a bound has no
 * tolerance. A program is solved when no condition is broken and S g_F is rounding. Pivoting may cycle, and has no safe
 * pivots where P is near singular: such a program is left unsolved.
 */
#include "block_pivoting.h"

#define SAFE_PIVOT ((real)1e-13) /* least share of the diagonal of P that a pivot has */
#define RESIDUAL ((real)64)      /* times the rounding of g: so much of g_F may be left */
#define SMALLEST ((real)1e-30)   /* least diagonal */

/* The largest of a vector's lanes, and their sum, where these are entries of one program. */
CORE_INLINE num largest_entry(vec8 a)
{
#ifdef CORE_TILE
    return a;
#else
    return largest8(a);
#endif
}

CORE_INLINE num sum_of_entries(vec8 a)
{
#ifdef CORE_TILE
    return a;
#else
    return sum8(a);
#endif
}

num N(pivoting_prepare)(const Pivoting *s)
{
    const int d = s->d;
    num fine = constant(1);
    for (int i = 0; i < d; ++i) {
        fine = both(fine, both(less(constant(SMALLEST), s->diagonal[i]), is_finite(s->diagonal[i])));
#ifndef CORE_TILE
        for (int j = i + 1; j < d; ++j) {
            row_of(s, j)[i] = row_of(s, i)[j];
        }
#endif
    }
    for (int i = 0; i < VECTORS(d); ++i) {
        set_vector(s->scale, i, root_scale(vector(s->diagonal, i)));
    }
    return fine;
}

/* g = q + P x, every entry in the order of the columns. */
static void gradient(const Pivoting *s)
{
    const int d = s->d;
#ifdef CORE_TILE
    int i = 0;
    memcpy(s->g, s->q, sizeof(num) * (size_t)d);
    for (; i + 1 < d; i += 2) { /* two rows at a time */
        const num *const row = row_of(s, i), *const next = row_of(s, i + 1);
        const num x = s->x[i], x_next = s->x[i + 1];
        num sum = plus_times(plus_times(s->g[i], row[i], x), row[i + 1], x_next);
        num sum_next = plus_times(plus_times(s->g[i + 1], row[i + 1], x), next[i + 1], x_next);
        for (int j = i + 2; j < d; ++j) {
            sum = plus_times(sum, row[j], s->x[j]);
            sum_next = plus_times(sum_next, next[j], s->x[j]);
            s->g[j] = plus_times(plus_times(s->g[j], row[j], x), next[j], x_next);
        }
        s->g[i] = sum;
        s->g[i + 1] = sum_next;
    }
    if (i < d) {
        s->g[i] = plus_times(s->g[i], row_of(s, i)[i], s->x[i]);
    }
#else
    for (int i = 0; i < VECTORS(d); i += 2) {
        const int pair = i + 1 < VECTORS(d);
        vec8 sum = vector(s->q, i), sum_next = vector(s->q, i + pair);
        for (int j = 0; j < d; ++j) {
            const num *const column = row_of(s, j);
            const vec8 x = splat(s->x[j]);
            sum = plus_product(sum, vector(column, i), x);
            sum_next = plus_product(sum_next, vector(column, i + pair), x);
        }
        set_vector(s->g, i, sum);
        if (pair) {
            set_vector(s->g, i + 1, sum_next);
        }
    }
    end_gradient(s);
#endif
}

/* Move variable j, and g with it. */
static void move_variable(const Pivoting *s, int j, num to)
{
    const num change = minus(to, s->x[j]);
    s->x[j] = to;
#ifdef CORE_TILE
    for (int i = 0; i < s->d; ++i) {
        s->g[i] = plus_times(s->g[i], i < j ? row_of(s, i)[j] : row_of(s, j)[i], change);
    }
#else
    for (int i = 0; i < VECTORS(s->d); ++i) {
        set_vector(s->g, i, plus_product(vector(s->g, i), vector(row_of(s, j), i), splat(change)));
    }
    end_gradient(s);
#endif
}

void N(pivoting_guess)(const Pivoting *s, num which)
{
    const num zero = constant(0), one = constant(1);
    for (int j = 0; j < s->d; ++j) {
        set_where(which, s->x + j, within(zero, s->lb[j], s->ub[j]));
    }
    gradient(s);
    for (int j = 0; j < s->d; ++j) {
        const num to = minus_times(s->x[j], s->g[j], times(s->scale[j], s->scale[j]));
        move_variable(s, j, choose(which, within(to, s->lb[j], s->ub[j]), s->x[j]));
    }
    for (int j = 0; j < s->d; ++j) {
        const num x = s->x[j], g = s->g[j], inside = if_less(s->lb[j], x, less(x, s->ub[j]), zero);
        const num at = if_less(x, s->ub[j], minus(zero, less(zero, g)), less(g, zero));
        set_where(which, s->side + j, choose(inside, zero, if_less(s->lb[j], s->ub[j], at, minus(zero, one))));
    }
}

void N(pivoting_place)(const Pivoting *s)
{
    for (int i = 0; i < VECTORS(s->d); ++i) {
        const vec8 side = vector(s->side, i), upper = where_less(zeros(), side, vector(s->ub, i), vector(s->x, i));
        set_vector(s->x, i, where_less(side, zeros(), vector(s->lb, i), upper));
        set_vector(s->free, i, where_less(zeros(), mul(side, side), zeros(), splat(1)));
    }
    gradient(s);
}

num N(pivoting_newton)(const Pivoting *s, real least)
{
    const int d = s->d;
    int count = 0;
    num safe;
    for (int i = 0; i < d; ++i) {
        row_of(s, i)[d] = minus(constant(0), s->g[i]);
        s->factor.rows[count] = i;
        count += any(s->free[i]);
    }
    safe = factorise(&s->factor, s->data, s->free, count, least);
    substitute_back(&s->factor, count, s->step);
    for (int place = 0; place < count; ++place) {
        const int i = s->factor.rows[place];
        s->x[i] = plus(s->x[i], s->step[i]);
    }
    gradient(s);
    return safe;
}

num N(pivoting_rounding)(const Pivoting *s)
{
    vec8 largest = zeros();
    for (int i = 0; i < VECTORS(s->d); ++i) {
        const vec8 scale = vector(s->scale, i), q = mul(scale, vector(s->q, i));
        const vec8 z = mul(mul(scale, vector(s->diagonal, i)), vector(s->x, i));
        largest = larger(larger(magnitude(q), magnitude(z)), largest);
    }
    return times(constant(4 * (real)s->d * REAL_EPSILON), largest_entry(largest));
}

num N(pivoting_exchange)(const Pivoting *s, num *residual)
{
    const num rounding = N(pivoting_rounding)(s);
    const vec8 tolerance = SPREAD(rounding);
    vec8 exchanged = zeros(), left = zeros(), finite = zeros();
    for (int i = 0; i < VECTORS(s->d); ++i) {
        const vec8 side = vector(s->side, i), x = vector(s->x, i), g = mul(vector(s->scale, i), vector(s->g, i));
        const vec8 lb = vector(s->lb, i), ub = vector(s->ub, i), one = splat(1), held = mul(side, side),
                   sum = add(x, g);
        const vec8 outside = where_less(x, lb, splat(-1), where_less(ub, x, one, zeros()));
        const vec8 kept = where_less(tolerance, mul(side, g), where_less(lb, ub, zeros(), side), side);
        const vec8 next = where_less(zeros(), held, kept, outside), change = sub(next, side);
        exchanged = add(exchanged, where_less(zeros(), mul(change, change), one, zeros()));
        left = larger(where_less(zeros(), held, zeros(), magnitude(g)), left);
        finite = add(finite, sub(sum, sum)); /* NaN where one is not finite */
        set_vector(s->side, i, next);
    }
    *residual = if_less(constant(0), largest_entry(left), divided(largest_entry(left), rounding), constant(0));
    *residual = if_less(sum_of_entries(finite), constant(1), *residual, constant(REAL_INFINITY));
    return sum_of_entries(exchanged);
}

num N(pivoting_round)(const Pivoting *s, num *broken)
{
    num safe, exchanged, residual;
    N(pivoting_place)(s);
    safe = N(pivoting_newton)(s, SAFE_PIVOT);
    exchanged = less(constant(0), N(pivoting_exchange)(s, &residual));
    *broken = both(safe, exchanged);
    return both(both(safe, is_not(exchanged)), less(residual, constant(RESIDUAL)));
}

#ifdef CORE_TILE
static void move_lane(const num *from, int lane, num *to, int into, int count)
{
    for (int i = 0; i < count; ++i) {
        ((real *)to)[i * LANES + into] = ((const real *)from)[i * LANES + lane];
    }
}

void pivoting_move(const Pivoting *from, int lane, const Pivoting *to, int into)
{
    move_lane(from->data, lane, to->data, into, symmetric_nums(from->d + 1));
    move_lane(from->lb, lane, to->lb, into, from->d);
    move_lane(from->ub, lane, to->ub, into, from->d);
    move_lane(from->x, lane, to->x, into, from->d);
    move_lane(from->side, lane, to->side, into, from->d);
    move_lane(from->scale, lane, to->scale, into, from->d);
    move_lane(from->q, lane, to->q, into, from->d);
    move_lane(from->diagonal, lane, to->diagonal, into, from->d);
}
#endif
