/* With the partial sums W_i of the weights over ascending thresholds 0 = r_0 < ... < r_n, the inverse of H has
 *
 *     w'_0 = 1/w_0,   w'_i = -w_i / (W_i W_(i-1)),   r'_i = sum over j <= i of w_j (r_i - r_j),   z'_i = W_i z_i + sum over j > i of w_j z_j.
 */
#include "compensator.h"

#define FARTHEST ((real)1e6) /* references beyond so many half ranges are taken for this, so that no sum overflows */

/* Vectors of the creep states: slow creep moves by less than the rounding of a float, so there the rest is carried along. */
#ifdef CORE_FLOAT
enum { CREEP_VECTORS = 2 };
#else
enum { CREEP_VECTORS = 1 };
#endif

int64_t compensator_bytes(Shape s)
{
    const int vectors = 6 * lanes(s) + (2 + CREEP_VECTORS) * creep_lanes(s) + 3 * zone_lanes(s) + padded(weight_count(s)) + 2 * LANES + 2 * LANES;
    return HEAD_BYTES + (int64_t)sizeof(real) * vectors;
}

Compensator compensator_at(void *memory)
{
    Compensator c;
    Room room = after_head(memory);
    c.head = memory;
    c.shape = SHAPE(c.head);
    c.operators = take_operators(&room, c.shape);
    c.S_inverse = take_superposition(&room, c.shape);
    c.w_H = reals(&room, 1, lanes(c.shape));
    c.W_H = reals(&room, 1, lanes(c.shape));
    c.w_H_inverse = reals(&room, 1, lanes(c.shape));
    c.r_H_inverse = reals(&room, 1, lanes(c.shape));
    c.w_K = reals(&room, 1, creep_lanes(c.shape));
    c.weights = reals(&room, 1, padded(weight_count(c.shape)));
    c.limits = (DriveLimits *)(void *)reals(&room, 2, LANES);
    c.fade = (Fade *)(void *)reals(&room, 1, LANES);
    c.feedback = (Feedback *)(void *)reals(&room, 1, LANES);
    c.play = reals(&room, 1, lanes(c.shape));
    c.creep = reals(&room, CREEP_VECTORS, creep_lanes(c.shape));
    return c;
}

void compensator_setup(void *memory, Shape shape)
{
    const ShapedHead head = {COMPENSATOR_KIND, unknowns(shape), compensator_bytes(shape), shape};
    memset(memory, 0, (size_t)head.bytes);
    memcpy(memory, &head, sizeof head);
}

void compensator_take(Compensator *c, const real *weights)
{
    const real *const r = c->operators.r, *const w_K = weights + c->shape.n + 1 + c->shape.zones;
    real W = weights[0], r_inverse = 0;
    memcpy(c->weights, weights, sizeof(real) * (size_t)weight_count(c->shape));
    c->w_H[0] = c->W_H[0] = W;
    c->w_H_inverse[0] = 1 / W;
    for (int i = 1; i <= c->shape.n; ++i) {
        const real before = W;
        r_inverse += W * (r[i] - r[i - 1]); /* the sum by parts */
        W += weights[i];
        c->w_H[i] = weights[i];
        c->W_H[i] = W;
        c->w_H_inverse[i] = -weights[i] / (W * before);
        c->r_H_inverse[i] = r_inverse;
    }
    memcpy(c->S_inverse.w, weights + c->shape.n + 1, sizeof(real) * (size_t)c->shape.zones);
    for (int j = 0; j < creep_lanes(c->shape); j += lanes(c->shape)) {
        memcpy(c->w_K + j, w_K, sizeof(real) * (size_t)creep_weights(c->shape));
    }
}

/* Drive that makes the model's next output y_ref, without any limit; all in unit amplitudes. */
static real wanted_drive(const Compensator *c, real y_ref)
{
    const real K = weighted_sum(c->w_K, c->creep, creep_lanes(c->shape));
    const real u = superposition(c->S_inverse, c->shape, y_ref) - K - c->weights[weight_count(c->shape) - 1];
    real x = c->w_H_inverse[0] * u, outside = 0;
    for (int i = c->shape.n; i > 0; --i) {
        const real z = c->W_H[i] * c->play[i] + outside;
        outside += c->w_H[i] * c->play[i];
        x += c->w_H_inverse[i] * play_step(u, c->r_H_inverse[i], z);
    }
    return x;
}

/* A finite reference in unit amplitudes, far-away ones brought near. */
static real unit_reference(const DriveLimits *p, real y_ref)
{
    return most(-FARTHEST, least(FARTHEST, (y_ref - p->y_centre) / p->y_scale));
}

static real within_limits(const DriveLimits *p, real x) { return most(p->unit_low, least(p->unit_high, x)); }

/* Move the states on by the sample x that the actuator really saw. */
static void move_on(const Compensator *c, real x)
{
#ifdef CORE_FLOAT
    real before[LANES];
    for (int j = 0; j < creep_lanes(c->shape); j += LANES) {
        real *const z = c->creep + j, *const rest = z + creep_lanes(c->shape);
        memcpy(before, z, sizeof before);
        for (int i = 0; i < LANES; ++i) {
            const int at = j + i;
            const real change = c->operators.a[at] * (play_step(x, c->operators.r[at % lanes(c->shape)], before[i]) - before[i]) + rest[i];
            z[i] = before[i] + change;
            rest[i] = change - (z[i] - before[i]);
        }
    }
    for (int i = 0; i < lanes(c->shape); ++i) {
        c->play[i] = play_step(x, c->operators.r[i], c->play[i]);
    }
#else
    advance(c->operators, c->shape, x, c->play, c->creep);
#endif
}

void compensator_correct(Compensator *c, real y)
{
    Feedback *const f = c->feedback;
    const real error = f->given - y, most_added = MAGNITUDE(c->limits->y_scale);
    if (f->gain > 0 && isfinite(error) && !(f->held * error / c->limits->y_scale > 0)) {
        f->correction = most(-most_added, least(most_added, f->correction + f->gain * error));
    }
}

real compensator_step(Compensator *c, real y_ref)
{
    const DriveLimits *const p = c->limits;
    Feedback *const f = c->feedback;
    const real last = c->play[0];
    real x = last, wanted = last;
    f->given = y_ref;
    if (isfinite(y_ref)) {
        c->fade->last_y_ref = y_ref + f->correction;
        wanted = wanted_drive(c, unit_reference(p, c->fade->last_y_ref)) + c->fade->bump;
        c->fade->bump *= c->fade->decay;
        x = most(last - p->max_step, least(last + p->max_step, wanted));
    }
    x = within_limits(p, x);
    f->held = (real)((wanted > x) - (wanted < x));
    x = p->x_centre + p->x_scale * x;
    x = most(p->low, least(p->high, x)); /* rounding may have passed a limit by its last bit */
    move_on(c, (x - p->x_centre) / p->x_scale);
    return x;
}

real compensator_now(const Compensator *c)
{
    return within_limits(c->limits, wanted_drive(c, unit_reference(c->limits, c->fade->last_y_ref)));
}

void compensator_hand_over(Compensator *c, const real *weights)
{
    const real before = compensator_now(c);
    compensator_take(c, weights);
    c->fade->bump += before - compensator_now(c);
}
