/* The data of a box problem: their memory, scaling and checks; and the solve. */
#include "box.h"

#include "symmetric.h"

enum { BOX_VECTORS = 28 };

static int even(int d) { return (d + 1) / 2 * 2; }

static int64_t vector_bytes(int64_t ld) { return HEAD_BYTES + ld * (BOX_VECTORS + 9) * (int64_t)sizeof(real) + 8 * ld; }

int64_t box_bytes(int d)
{
    const int64_t ld = padded(d);
    return vector_bytes(ld) + ld * (2 * even(d) + 2 * ld) * (int64_t)sizeof(real);
}

/* clang-format off */
/* The vectors of a state, in rows of ld entries. */
#define BOX_PARTS(F)                                                                                                   \
    F(answer, 1) F(scale, 1) F(q, 1) F(lo, 1) F(hi, 1) F(raw_q, 1) F(lb, 1) F(ub, 1) F(x, 1) F(g, 1) /* data */        \
    F(basic, 1) F(low, 1) F(high, 1) F(held, 1) F(is_free, 1) F(unit, 1) F(diagonal, 1) F(weight, 1) F(gain, 1)        \
    F(residual, 1) F(step, 1) F(inverse_diagonal, 1) F(multiplier, 1) F(linear, 1) F(centre, 1) F(zero, 1) F(v, 1)     \
    F(w, 1) F(pair, 5) F(factor, 2) F(share, 2)
#define PLACE(name, rows) s.name = at, at += (rows) * s.ld;
/* clang-format on */

Box box_at(void *memory)
{
    const int d = VARIABLES((const BoxHead *)memory);
    Box s = {.head = memory, .d = d, .ld = padded(d)};
    real *at = (real *)(void *)after_head(memory).at;
    BOX_PARTS(PLACE)
    Arena arena = {(char *)at};
    s.side = integers(&arena, d);
    s.P = reals(&arena, even(d), s.ld);
    s.M = reals(&arena, even(d), s.ld);
    s.U = reals(&arena, 2 * s.ld, s.ld);
    return s;
}

static int set_bounds(const Box *s, const real *lb, const real *ub)
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

int box_setup(void *memory, int d, const real *lb, const real *ub)
{
    real v = (real)0.618033988749895;
    new_state(memory, BOX_KIND, d, vector_bytes(padded(d))); /* matrices are written before they are read */
    Box s = box_at(memory);
    s.head->bytes = box_bytes(d);
    for (int j = 0; j < d; ++j) { /* multiples of the golden section modulo one and their squares, so that v_i w_j = v_j
                                     w_i only for i = j */
        s.v[j] = v;
        s.w[j] = v * v;
        v += (real)0.618033988749895;
        v -= v >= 1 ? 1 : 0;
    }
    for (int j = 0; j < s.ld; ++j) {
        s.scale[j] = 1;
        s.inverse_diagonal[j] = s.diagonal[j] = -1;
        s.lo[j] = s.lb[j] = -REAL_INFINITY;
        s.hi[j] = s.ub[j] = REAL_INFINITY;
    }
    if (d % 2 != 0) { /* sweeps take pairs of rows */
        real *const last = s.P + (size_t)d * (size_t)s.ld;
        memset(last, 0, (size_t)s.ld * sizeof(real));
        last[d] = 1;
    }
    return set_bounds(&s, lb, ub);
}

/* q and the bounds in the scaled variables. */
static void rescale(const Box *s)
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

/* The symmetric part of S P S for an unchecked P. */
static int copy_checked(Box *s, const real *P)
{
    for (int j = 0; j < s->d; ++j) {
        const real diagonal = P[j * s->d + j];
        s->scale[j] = diagonal > 0 && diagonal < REAL_INFINITY ? exact_root_scale(diagonal) : 1;
    }
    return scaled_symmetric(P, s->d, s->ld, s->scale, s->P);
}

static int set_hessian(Box *s, const real *P)
{
    int status = OK;
    s->head->singular = 0;
    if (!box_invert(s, P)) {
        status = copy_checked(s, P);
        if (status == OK && !box_invert(s, NULL)) {
            status = box_regularise(s);
        }
    }
    rescale(s);
    return status;
}

static int set_linear(const Box *s, const real *q)
{
    vec8 nothing = zeros();
    memcpy(s->raw_q, q, (size_t)s->d * sizeof(real));
    for (int j = 0; j < s->ld; j += LANES) {
        const vec8 raw = load(s->raw_q + j);
        nothing = add(nothing, sub(raw, raw)); /* NaN if q is not finite */
        store(s->q + j, mul(raw, load(s->scale + j)));
    }
    return sum8(nothing) == 0 ? OK : NOT_FINITE;
}

int box_set_data(Box *s, const real *P, const real *q)
{
    const int status = P != NULL ? set_hessian(s, P) : OK;
    return status == OK && q != NULL ? set_linear(s, q) : status;
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

static void write_answer(const Box *s)
{
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 x = maximum(minimum(load(s->x + b), load(s->hi + b)), load(s->lo + b));
        store(s->answer + b, mul(load(s->scale + b), x));
    }
}

int box_solve(Box *s, int warm)
{
    Search search = {.linear = s->q};
    int status = OK;
    s->head->refinements = 0;
    s->head->proximal_steps = 0;
    if (!s->head->singular) {
        box_begin(s, &search, warm);
        status = box_dual_active_set(s, &search);
        if (status == BREAKDOWN && box_regularise(s) != OK) {
            return INDEFINITE;
        }
    }
    if (s->head->singular) {
        status = box_proximal_point(s, &search, warm);
    }
    s->head->exchanges = search.exchanges;
    write_answer(s);
    return status;
}

int box_solve_from(void *memory, int d, const real *P, const real *q, const real *lb, const real *ub, const real *x)
{
    int status = box_setup(memory, d, lb, ub);
    Box s = box_at(memory);
    status = status == OK ? box_set_data(&s, P, q) : status;
    status = status == OK ? box_start(&s, x) : status;
    return status == OK ? box_solve(&s, 1) : status;
}

int box_solve_anew(Box *s, const real *P, const real *q, const real *lb, const real *ub)
{
    int status = set_bounds(s, lb, ub);
    status = status == OK ? box_set_data(s, P, q) : status;
    return status == OK ? box_solve(s, 0) : status;
}
