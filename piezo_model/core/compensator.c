/* With the partial sums W_i of the weights over ascending thresholds 0 = r_0 < ... < r_n, the inverse of H has
 *
 *     w'_0 = 1/w_0,   w'_i = -w_i / (W_i W_(i-1)),   r'_i = sum over j <= i of w_j (r_i - r_j),   z'_i = W_i z_i + sum
 * over j > i of w_j z_j.
 */
#include "compensator.h"

#define FARTHEST ((real)1e6) /* limit of references in half ranges, so that no sum overflows */

/* Contribution of creep to the next output, before S. */
static num creep_sum(const Compensator *c)
{
    const int k = play_vectors(c->shape);
    Sum creep = no_sum();
    for (int j = 0; j < c->shape.rates; ++j) {
        for (int i = 0; i < k; ++i) {
            accumulate(&creep, i, vector(c->inverse.w_K, i), vector(c->creep, j * k + i));
        }
    }
    return total(&creep);
}

/* Drive without limits that makes y_ref the model's next output; in normalised units. */
static num wanted_drive(const Compensator *c, num y_ref, num creep)
{
    const Inverse *const p = &c->inverse;
    const Shape s = c->shape;
    num u, x, outside = constant(0);
    u = minus(minus(superposition(c->low, c->high, p->w_S, s, y_ref), creep), p->offset[0]);
    x = times(p->w_H_inverse[0], u);
    for (int i = s.n; i > 0; --i) {
        const num z = plus_times(outside, p->W_H[i], c->play[i]);
        outside = plus_times(outside, p->w_H[i], c->play[i]);
        x = plus_times(x, p->w_H_inverse[i], play_of(u, p->r_H_inverse[i], z));
    }
    return x;
}

/* The model's output in the output unit for the present states of play, before dynamics. */
static num output_of(const Compensator *c, num creep)
{
    const Inverse *const p = &c->inverse;
    const vec8 u = SPREAD(plus(plus(dot(p->w_H, c->play, play_vectors(c->shape)), creep), p->offset[0]));
    Sum sum = no_sum();
    for (int i = 0; i < VECTORS(c->shape.zones); ++i) {
        accumulate(&sum, i, vector(p->w_S_inverse, i), dead_zone8(u, vector(p->low, i), vector(p->high, i)));
    }
    return plus_times(constant(c->settings->y_centre), constant(c->settings->y_scale), total(&sum));
}

/* The output of F for the last finite reference, and with integral action what the stage should have put out. */
static num filtered(const Compensator *c, num y_ref, num finite)
{
    const DriveSettings *const p = c->settings;
    DriveMemory *const m = c->memory;
    num *const reference = &c->prefilter.memory->reference;
    const num centre = constant(p->y_centre), most = constant(FARTHEST * MAGNITUDE(p->y_scale)),
              low = minus(centre, most), high = plus(centre, most);
    if (p->gain > 0) {
        set_where(finite, reference, within(y_ref, low, high));
        m->target = where(finite, N(model_filter)(&c->prefilter, c->shape, *reference), y_ref);
    }
    return N(reference_filter)(&c->prefilter, c->shape, within(m->last_y_ref, low, high));
}

/* A finite reference in normalised units, limited to FARTHEST. */
static num unit_reference(const Compensator *c, num y_ref)
{
    const num unit = divided(minus(y_ref, constant(c->settings->y_centre)), constant(c->settings->y_scale));
    return within(unit, constant(-FARTHEST), constant(FARTHEST));
}

static num within_limits(const Compensator *c, num x) { return within(x, c->memory->unit_low, c->memory->unit_high); }

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
        const num error = minus(m->target, y), most_added = constant(MAGNITUDE(p->y_scale));
        const num beyond = less(constant(0), times(m->saturated, divided(error, constant(p->y_scale))));
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
    m->target = y_ref;
    set_where(finite, &m->last_y_ref, plus(y_ref, m->correction));
    const num reference = unit_reference(c, c->shape.ring > 0 ? filtered(c, y_ref, finite) : m->last_y_ref);
    num creep = creep_sum(c), wanted = wanted_drive(c, reference, creep);
    if (change != NULL) {
        const num before = wanted;
        copy_where(change->which, c->inverse.w_H, change->inverse.w_H, inverse_nums(c->shape));
        creep = creep_sum(c);
        wanted = wanted_drive(c, reference, creep);
        set_where(change->which, &m->bump, plus(m->bump, minus(within_limits(c, before), within_limits(c, wanted))));
    }
    wanted = where(finite, plus(wanted, m->bump), last);
    set_where(finite, &m->bump, flushed(times(m->bump, constant(p->decay))));
    num x = within_limits(c, where(finite, within(wanted, minus(last, step), plus(last, step)), last));
    m->saturated = minus(less(x, wanted), less(wanted, x));
    x = within(plus_times(x_centre, x_scale, x), m->low, m->high); /* rounding may exceed a limit by a bit */
    flush_in_turn(c);
    receive(c->operators, c->shape, divided(minus(x, x_centre), x_scale), c->play, c->creep);
    if (c->shape.modes > 0) {
        const num elsewhere = logical_or(absolute(m->saturated), is_not(finite));
        N(reference_follow)(&c->prefilter, c->shape, output_of(c, creep), elsewhere);
    }
    return x;
}

void N(compensator_balance)(const Compensator *c, num which)
{
    if (c->shape.ring > 0) {
        N(prefilter_balance)(&c->prefilter, c->shape, which, output_of(c, creep_sum(c)), c->play, c->creep);
    }
    set_where(which, &c->memory->target, constant((real)NAN));
}

num N(compensator_now)(const Compensator *c)
{
    const num reference = c->shape.ring > 0 ? c->prefilter.memory->output : c->memory->last_y_ref;
    return within_limits(c, wanted_drive(c, unit_reference(c, reference), creep_sum(c)));
}

#ifndef CORE_TILE
int64_t compensator_bytes(Shape s)
{
    const int numbers = 2 * LANES + lanes(s) + rate_lanes(s) + 2 * zone_lanes(s) + 2 * LANES + lanes(s)
                        + CREEP_VECTORS * creep_lanes(s) + inverse_nums(s) + prefilter_nums(s);
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
    c.prefilter = prefilter_at(&arena, c.shape);
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
    invert(p, c->shape, c->operators.r, c->low, c->high);
}
#endif
