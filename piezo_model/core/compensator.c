/* With the partial sums W_i of the weights over ascending thresholds 0 = r_0 < ... < r_n, the inverse of H has
 *
 *     w'_0 = 1/w_0,   w'_i = -w_i / (W_i W_(i-1)),   r'_i = sum over j <= i of w_j (r_i - r_j),   z'_i = W_i z_i + sum
 * over j > i of w_j z_j.
 */
#include "compensator.h"

#define FARTHEST ((real)1e6) /* limit of references in half ranges, so that no sum overflows */

/* Drive without limits that makes y_ref the model's next output; in normalised units. */
static num wanted_drive(const Compensator *c, num y_ref)
{
    const Inverse *const p = &c->inverse;
    const Shape s = c->shape;
    const int k = play_vectors(s);
    Sum creep = no_sum();
    num u, x, outside = constant(0);
    for (int j = 0; j < s.rates; ++j) {
        for (int i = 0; i < k; ++i) {
            accumulate(&creep, i, vector(p->w_K, i), vector(c->creep, j * k + i));
        }
    }
    u = minus(minus(superposition(c->low, c->high, p->w_S, s, y_ref), total(&creep)), p->offset[0]);
    x = times(p->w_H_inverse[0], u);
    for (int i = s.n; i > 0; --i) {
        const num z = plus_times(outside, p->W_H[i], c->play[i]);
        outside = plus_times(outside, p->w_H[i], c->play[i]);
        x = plus_times(x, p->w_H_inverse[i], play_of(u, p->r_H_inverse[i], z));
    }
    return x;
}

/* A finite reference in normalised units, limited to FARTHEST. */
static num unit_reference(const Compensator *c, num y_ref)
{
    const num unit = divided(minus(y_ref, constant(c->settings->y_centre)), constant(c->settings->y_scale));
    return within(unit, constant(-FARTHEST), constant(FARTHEST));
}

static num within_limits(const Compensator *c, num x) { return within(x, c->memory->unit_low, c->memory->unit_high); }

/* Advance the states by the drive x that the actuator receives. */
static void move_on(const Compensator *c, num x)
{
#ifdef CORE_FLOAT
    /* Slow creep moves by less than the rounding of a float, so the remainder is carried. */
    const Shape s = c->shape;
    for (int j = 0; j < creep_lanes(s); ++j) {
        real *const z = c->creep + j, *const rest = z + creep_lanes(s), before = *z;
        const real change =
            c->operators.a[j / lanes(s)] * (play_of(x, c->operators.r[j % lanes(s)], before) - before) + *rest;
        *z = before + change;
        *rest = change - (*z - before);
    }
    for (int i = 0; i < lanes(s); ++i) {
        c->play[i] = play_of(x, c->operators.r[i], c->play[i]);
    }
#else
    advance(c->operators, c->shape, x, c->play, c->creep);
#endif
}

/* Set decayed creep states to zero, eight states of one rate for each sample. */
static void flush_in_turn(const Compensator *c)
{
    const int k = play_vectors(c->shape), together = VECTORS(LANES), eights = (k + together - 1) / together;
    const int turns = eights * c->shape.rates;
    const real next = *(const real *)(const void *)&c->memory->turn;
    const int turn = next >= 0 && next < (real)turns ? (int)next : 0, first = turn % eights * together;
    for (int i = first; turns > 0 && i < k && i < first + together; ++i) {
        const int at = turn / eights * k + i;
        set_vector(c->creep, at, flushed8(vector(c->creep, at)));
    }
    c->memory->turn = constant((real)(turn + 1 < turns ? turn + 1 : 0));
}

void N(compensator_correct)(const Compensator *c, num y, num trusted)
{
    DriveMemory *const m = c->memory;
    const DriveSettings *const p = c->settings;
    if (p->gain > 0) {
        const num error = minus(m->given, y), most_added = constant(MAGNITUDE(p->y_scale));
        const num beyond = less(constant(0), times(m->held, divided(error, constant(p->y_scale))));
        const num sum =
            within(plus_times(m->correction, constant(p->gain), error), minus(constant(0), most_added), most_added);
        set_where(logical_and(trusted, logical_and(is_finite(error), is_not(beyond))), &m->correction, sum);
    }
}

num N(compensator_step)(const Compensator *c, num y_ref, const Change *change)
{
    const DriveSettings *const p = c->settings;
    DriveMemory *const m = c->memory;
    const num last = c->play[0], step = constant(p->max_step),
              finite = is_finite(y_ref); /* the play of threshold zero is the drive */
    const num x_centre = constant(p->x_centre), x_scale = constant(p->x_scale);
    m->given = y_ref;
    set_where(finite, &m->last_y_ref, plus(y_ref, m->correction));
    const num reference = unit_reference(c, m->last_y_ref);
    num wanted = wanted_drive(c, reference);
    if (change != NULL) {
        const num before = wanted;
        copy_where(change->which, c->inverse.w_H, change->inverse.w_H, inverse_nums(c->shape));
        wanted = wanted_drive(c, reference);
        set_where(change->which, &m->bump, plus(m->bump, minus(within_limits(c, before), within_limits(c, wanted))));
    }
    wanted = where(finite, plus(wanted, m->bump), last);
    set_where(finite, &m->bump, flushed(times(m->bump, constant(p->decay))));
    num x = within_limits(c, where(finite, within(wanted, minus(last, step), plus(last, step)), last));
    m->held = minus(less(x, wanted), less(wanted, x));
    x = within(plus_times(x_centre, x_scale, x), m->low, m->high); /* rounding may exceed a limit by a bit */
    flush_in_turn(c);
    move_on(c, divided(minus(x, x_centre), x_scale));
    return x;
}

num N(compensator_now)(const Compensator *c)
{
    return within_limits(c, wanted_drive(c, unit_reference(c, c->memory->last_y_ref)));
}

#ifndef CORE_TILE
enum { CREEP_VECTORS = sizeof(real) == 4 ? 2 : 1 }; /* with the remainders in single precision */

int64_t compensator_bytes(Shape s)
{
    const int numbers = 2 * LANES + lanes(s) + rate_lanes(s) + 2 * zone_lanes(s) + 2 * LANES + lanes(s)
                        + CREEP_VECTORS * creep_lanes(s) + inverse_nums(s);
    return HEAD_BYTES + (int64_t)sizeof(real) * numbers;
}

Compensator compensator_at(void *memory)
{
    Compensator c = {.shape = SHAPE((const ShapedHead *)memory)};
    Arena arena = after_head(memory);
    c.settings = (const DriveSettings *)(void *)reals(&arena, 2, LANES);
    c.operators = operators_at(&arena, c.shape);
    c.low = reals(&arena, 1, zone_lanes(c.shape));
    c.high = reals(&arena, 1, zone_lanes(c.shape));
    c.memory = (DriveMemory *)(void *)reals(&arena, 2, LANES);
    c.play = nums(&arena, lanes(c.shape));
    c.creep = nums(&arena, CREEP_VECTORS * creep_lanes(c.shape));
    c.inverse = inverse_at(&arena, c.shape);
    return c;
}

Compensator compensator_setup(void *memory, Shape shape)
{
    new_shaped_state(memory, COMPENSATOR_KIND, shape, compensator_bytes(shape));
    return compensator_at(memory);
}

void compensator_set_weights(const Compensator *c, const real *weights)
{
    const Inverse *const p = &c->inverse;
    const int n = c->shape.n, zones = c->shape.zones;
    memcpy(p->w_H, weights, sizeof(real) * (size_t)(n + 1));
    memcpy(p->w_S, weights + n + 1, sizeof(real) * (size_t)zones);
    memcpy(p->w_K, weights + n + 1 + zones, sizeof(real) * (size_t)creep_weights(c->shape));
    p->offset[0] = weights[weight_count(c->shape) - 1];
    invert(p, c->shape, c->operators.r);
}
#endif
