/* The data of a box problem: room for them, scaling, checks. */
#include "box_fallback.h"

enum { BOX_VECTORS = 25 };
#define ASYMMETRIC_SHARE ((real)1e-9) /* of sqrt(P_ii P_jj) */

static int even(int d) { return (d + 1) / 2 * 2; }

int64_t box_bytes(int d)
{
    const int64_t ld = padded(d), each = (int64_t)sizeof(real), columns = 2 * ld * ld * each;
    return HEAD_BYTES + ld * (BOX_VECTORS + 8 + 2 * even(d)) * each + 8 * ld
           + (columns > fallback_bytes(d) ? columns : fallback_bytes(d));
}

Box box_at(void *memory)
{
    const int d = VARIABLES((const BoxHead *)memory);
    Box s = {.head = memory, .d = d, .ld = padded(d)};
    Arena arena = after_head(memory);
    const Extent extents[] = {{&s.answer, s.ld},      {&s.scale, s.ld},
                              {&s.q, s.ld},           {&s.lo, s.ld},
                              {&s.hi, s.ld},          {&s.raw_q, s.ld},
                              {&s.lb, s.ld},          {&s.ub, s.ld},
                              {&s.x, s.ld},           {&s.g, s.ld},
                              {&s.basic, s.ld},       {&s.low, s.ld},
                              {&s.high, s.ld},        {&s.held, s.ld},
                              {&s.is_free, s.ld},     {&s.unit, s.ld},
                              {&s.diagonal, s.ld},    {&s.weight, s.ld},
                              {&s.gain, s.ld},        {&s.residual, s.ld},
                              {&s.step, s.ld},        {&s.inverse_diagonal, s.ld},
                              {&s.zero, s.ld},        {&s.v, s.ld},
                              {&s.w, s.ld},           {&s.pair, 4 * s.ld},
                              {&s.factor, 2 * s.ld},  {&s.share, 2 * s.ld},
                              {&s.P, even(d) * s.ld}, {&s.M, even(d) * s.ld}};
    LAY_OUT(&arena, extents);
    s.side = integers(&arena, d);
    s.U = reals(&arena, 2 * s.ld, s.ld);
    s.fallback = s.U;
    return s;
}

int box_setup(void *memory, int d, const real *lb, const real *ub)
{
    real v = (real)0.618033988749895;
    new_state(memory, BOX_KIND, d, box_bytes(d));
    Box s = box_at(memory);
    for (int j = 0; j < d; ++j) { /* multiples of the golden section modulo one and their squares, so that v_i w_j = v_j
                                     w_i only for i = j */
        s.v[j] = v;
        s.w[j] = v * v;
        v += (real)0.618033988749895;
        v -= v >= 1 ? 1 : 0;
    }
    for (int j = 0; j < s.ld; ++j) {
        s.scale[j] = 1;
        s.inverse_diagonal[j] = -1;
        s.lo[j] = s.lb[j] = -REAL_INFINITY;
        s.hi[j] = s.ub[j] = REAL_INFINITY;
    }
    if (d % 2 != 0) {
        s.P[(size_t)d * (size_t)s.ld + (size_t)d] = 1;
    }
    return box_take_bounds(&s, lb, ub);
}

int box_take_bounds(Box *s, const real *lb, const real *ub)
{
    for (int j = 0; j < s->d; ++j) {
        if (!(lb[j] == lb[j] && ub[j] == ub[j])) {
            return NOT_FINITE;
        }
        if (!(lb[j] <= ub[j] && lb[j] < REAL_INFINITY && ub[j] > -REAL_INFINITY)) {
            return CROSSED;
        }
        s->lb[j] = lb[j];
        s->ub[j] = ub[j];
    }
    return OK;
}

/* q and the bounds in the scaled variables. */
void box_rescale(Box *s)
{
    for (int j = 0; j < s->ld; j += LANES) {
        const vec8 scale = load(s->scale + j), inverse = divide(splat(1), scale);
        store(s->q + j, mul(load(s->raw_q + j), scale));
        store(s->lo + j, mul(load(s->lb + j), inverse));
        store(s->hi + j, mul(load(s->ub + j), inverse));
    }
}

/* 2^-floor(e / 2) for v = m 2^e > 0 with m in [1/2, 1). */
static real exact_root_scale(real v)
{
    const real up = 16777216; /* 2^24, whose root is 2^12, until v is a normal number */
    real lanes[LANES], factor = 1;
    for (int k = 0; k < 64 && (v * REAL_EPSILON == 0 || v * up * REAL_EPSILON * REAL_EPSILON == 0); ++k) {
        v *= up;
        factor *= 4096;
    }
    store(lanes, root_scale(splat(v)));
    return factor * lanes[0];
}

/* S P S for a P of which nothing is known. */
static int copy_checked(Box *s, const real *P)
{
    const int d = s->d, ld = s->ld;
    for (int j = 0; j < d; ++j) {
        const real diagonal = P[j * d + j];
        if (!(MAGNITUDE(diagonal) < REAL_INFINITY)) {
            return NOT_FINITE;
        }
        if (diagonal < 0) {
            return INDEFINITE;
        }
        s->scale[j] = diagonal > 0 ? exact_root_scale(diagonal) : 1;
    }
    for (int i = 0; i < d; ++i) {
        for (int j = 0; j < d; ++j) {
            s->P[i * ld + j] = P[i * d + j] * (s->scale[i] * s->scale[j]);
        }
    }
    box_rescale(s);
    return box_factorise_copy(s);
}

int box_take_hessian(Box *s, const real *P)
{
    if (box_invert(s, P)) {
        box_rescale(s);
        s->head->factorised = 0;
        s->head->singular = 0;
        return OK;
    }
    return copy_checked(s, P);
}

/* Put the symmetric part of the copy of P into the program of the fallback; NaN where it is not finite, else the
 * largest difference. */
static real symmetric_part(const Box *s, const Pivoting *p)
{
    const int d = s->d, ld = s->ld;
    vec8 total = zeros(), unequal = zeros();
    for (int i = 0; i < d; ++i) {
        real *const row = row_of(p, i);
        for (int j = i / LANES * LANES; j < d; ++j) {
            row[j] = s->P[j * ld + i];
        }
        row[d] = 0;
    }
    for (int i = 0; i < d; ++i) {
        real *const row = row_of(p, i);
        const real *const copy = s->P + i * ld;
        for (int b = i / LANES * LANES; b < ld; b += LANES) {
            const vec8 a = load(row + b), c = load(copy + b), mean = mul(splat((real)0.5), add(a, c));
            total = add(total, sub(mean, mean));
            unequal = larger(magnitude(sub(a, c)), unequal);
            store(row + b, mean);
        }
    }
    return sum8(total) + largest8(unequal);
}

/* The variables are scaled already. */
static void prepare(const Pivoting *p)
{
    for (int i = 0; i < p->d; ++i) {
        p->diagonal[i] = 1;
    }
    pivoting_prepare(p);
}

/* Solve for a right-hand side with everything free; the largest entry, infinite where a pivot is not safe. */
static real length_of_solution(const Pivoting *p, real least, const real *right)
{
    real longest = 0;
    for (int i = 0; i < p->d; ++i) {
        p->free[i] = 1;
        p->factor.rows[i] = i;
        row_of(p, i)[p->d] = right[i];
    }
    if (!(factorise(&p->factor, p->data, p->free, p->d, least) > 0)) {
        return REAL_INFINITY;
    }
    substitute_back(&p->factor, p->d, p->step);
    for (int i = 0; i < p->d; ++i) {
        longest = MAGNITUDE(p->step[i]) > longest ? MAGNITUDE(p->step[i]) : longest;
    }
    return longest;
}

/* Factorise the symmetric part of the copy of P; where that shows it near singular, add the proximal term. */
int box_factorise_copy(Box *s)
{
    const Fallback f = fallback_at(s);
    const Pivoting *const p = &f.program;
    const real unequal = symmetric_part(s, p);
    if (!(unequal < REAL_INFINITY)) {
        return NOT_FINITE;
    }
    if (unequal > ASYMMETRIC_SHARE) {
        return ASYMMETRIC;
    }
    prepare(p);
    s->head->singular = 0;
    s->head->factorised = 1;
    /* Pivots alone do not show a null vector that has little of the last variable, the length of a solution does: the
     * right-hand side is irregular, so that this is about 1/lambda_min. */
    for (int j = 0; j < s->d; ++j) {
        f.centre[j] = s->v[j] - (real)0.5;
    }
    if (length_of_solution(p, 16 * (real)s->d * REAL_EPSILON, f.centre) * (real)s->d * REAL_EPSILON < (real)0.02) {
        return OK;
    }
    return box_regularise(&f);
}

int box_regularise(const Fallback *f)
{
    const Pivoting *const p = &f->program;
    for (int j = 0; j < p->d; ++j) {
        row_of(p, j)[j] += BOX_PROXIMAL;
    }
    prepare(p);
    f->head->singular = 1;
    f->head->inverted = 0;
    return length_of_solution(p, 0, f->centre) < REAL_INFINITY ? OK : INDEFINITE;
}

int box_take_linear(Box *s, const real *q)
{
    vec8 nothing = zeros();
    memcpy(s->raw_q, q, (size_t)s->d * sizeof(real));
    for (int j = 0; j < s->ld; j += LANES) {
        const vec8 raw = load(s->raw_q + j);
        nothing = add(nothing, sub(raw, raw)); /* NaN where q is not finite */
        store(s->q + j, mul(raw, load(s->scale + j)));
    }
    return sum8(nothing) == 0 ? OK : NOT_FINITE;
}

int box_start(Box *s, const real *x)
{
    for (int j = 0; j < s->d; ++j) {
        if (!(MAGNITUDE(x[j]) < REAL_INFINITY)) {
            return NOT_FINITE;
        }
        s->answer[j] = x[j];
        s->side[j] = x[j] >= s->ub[j] ? UPPER : x[j] <= s->lb[j] ? LOWER : FREE;
    }
    return OK;
}
