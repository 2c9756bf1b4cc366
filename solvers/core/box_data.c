/* The data of a box problem: their memory, scaling and checks; and the solve. */
#include "box.h"

#include "symmetric.h"

enum { BOX_VECTORS = 35, BOX_CLEARED = 13 }; /* rows of all vectors, and of those that must begin as zeros */

static int even(int d) { return (d + 1) / 2 * 2; }

static int64_t vector_bytes(int64_t ld, int rows) { return HEAD_BYTES + ld * (rows * (int64_t)sizeof(real) + 8); }

int64_t box_bytes(int d)
{
    const int64_t ld = padded(d);
    return vector_bytes(ld, BOX_VECTORS) + ld * (2 * even(d) + 2 * ld) * (int64_t)sizeof(real);
}

/* clang-format off */
/* The vectors of a state, in rows of ld entries; those from `diagonal` on are written before they are read. A list of
 * fields for LAY_OUT would take gcc 60 to 80 cycles more in each call, a tenth of a solve at d = 5. */
#define BOX_PARTS(F)                                                                                                   \
    F(answer, 1) F(raw_q, 1) F(basic, 1) F(low, 1) F(high, 1) F(fixed_at, 1) F(is_free, 1) F(unit, 1) F(weight, 1)         \
    F(gain, 1) F(linear, 1) F(centre, 1) F(zero, 1)                                                                    \
    F(diagonal, 1) F(lb, 1) F(ub, 1) F(multiplier, 1) F(scale, 1) F(q, 1) F(z_lb, 1) F(z_ub, 1) F(z, 1) F(grad_z, 1)   \
    F(residual, 1) F(step, 1) F(inverse_diagonal, 1) F(sweep_scratch, 5) F(inverse_pivot, 2) F(coefficient, 2)
#define PLACE(name, rows) s.name = at, at += (rows) * s.ld;
/* clang-format on */

Box box_at(void *memory)
{
    const int d = VARIABLES((const BoxHead *)memory);
    Box s = {.head = memory, .d = d, .ld = padded(d)};
    Arena arena = after_head(memory);
    s.side = integers(&arena, d);
    real *at = (real *)(void *)arena.at;
    BOX_PARTS(PLACE)
    arena.at = (char *)at;
    s.P = reals(&arena, even(d), s.ld);
    s.M = reals(&arena, even(d), s.ld);
    s.U = reals(&arena, 2 * s.ld, s.ld);
    return s;
}

int box_setup(void *memory, int d, const real *lb, const real *ub)
{
    new_state(memory, BOX_KIND, d, vector_bytes(padded(d), BOX_CLEARED));
    Box s = box_at(memory);
    s.head->bytes = box_bytes(d);
    s.head->of_P = s.head->of_q = UNSET;
    for (int j = 0; j < s.ld; j += LANES) {
        store(s.diagonal + j, splat(-1));
        store(s.lb + j, splat(-REAL_INFINITY));
        store(s.ub + j, splat(REAL_INFINITY));
    }
    if (d % 2 != 0) { /* sweeps take pairs of rows */
        real *const last = s.P + (size_t)d * (size_t)s.ld;
        memset(last, 0, (size_t)s.ld * sizeof(real));
        last[d] = 1;
    }
    memcpy(s.lb, lb, (size_t)d * sizeof(real));
    memcpy(s.ub, ub, (size_t)d * sizeof(real));
    return s.head->of_bounds = status_of_bounds(d, lb, ub);
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

/* Least size of z whose squares, and those of its rounding, are safe. */
#define LEAST_SIZE ((real)4.9e-91)

/* q and the bounds in the scaled variables; none for a variable apart. Their size, that of q or of the bounds that keep
 * z from 0, is left alone unless products could leave the range of the numbers. */
static void rescale(Box *s)
{
    const vec8 cost = splat(s->head->cost), infinity = splat(REAL_INFINITY), none = zeros();
    vec8 size = none;
    for (int j = 0; j < s->ld; j += LANES) {
        const vec8 scale = load(s->scale + j), inverse = where_less(none, scale, divide(splat(1), scale), none);
        const vec8 q = mul(load(s->raw_q + j), mul(cost, scale));
        const vec8 lo = maximum(mul(load(s->lb + j), inverse), sub(none, infinity)); /* 0 times infinity is NaN */
        const vec8 hi = minimum(mul(load(s->ub + j), inverse), infinity);
        store(s->q + j, q);
        store(s->z_lb + j, lo);
        store(s->z_ub + j, hi);
        size = maximum(maximum(lo, sub(none, hi)), maximum(magnitude(q), size));
    }
    const real most = largest8(size);
    const int is_safe = !(most > 0 && most < REAL_INFINITY) || (most > LEAST_SIZE && most < 1 / LEAST_SIZE);
    s->head->root = is_safe ? 1 : exact_root_scale(most);
    for (int j = 0; !is_safe && j < s->ld; j += LANES) {
        const vec8 root = splat(s->head->root);
        store(s->q + j, mul(mul(load(s->q + j), root), root));
        store(s->z_lb + j, mul(mul(load(s->z_lb + j), root), root));
        store(s->z_ub + j, mul(mul(load(s->z_ub + j), root), root));
    }
}

/* The symmetric part of c S P S for an unchecked P, with rows of the unit matrix for those that are zero. */
static int copy_checked(Box *s, const real *P)
{
    const int d = s->d;
    s->head->cost = 0;
    for (int j = 0; j < s->ld; ++j) {
        const real diagonal = j < d ? P[j * d + j] : 0;
        const int is_normal = diagonal > 0 && diagonal < REAL_INFINITY;
        s->head->cost = is_normal && s->head->cost == 0 ? box_cost(diagonal) : s->head->cost;
        s->scale[j] = is_normal ? exact_root_scale(s->head->cost * diagonal) : 1;
    }
    s->head->cost = s->head->cost > 0 ? s->head->cost : 1;
    const int status = scaled_symmetric(P, d, s->ld, s->scale, s->P);
    for (int i = 0; i < d; ++i) {
        real *const row = s->P + (size_t)i * (size_t)s->ld, most = 0;
        for (int j = 0; j < d; ++j) {
            most = MAGNITUDE(row[j]) > most ? MAGNITUDE(row[j]) : most;
            row[j] *= s->head->cost;
        }
        if (most == 0) {
            s->head->apart = 1;
            s->scale[i] = 0;
            row[i] = 1;
        }
    }
    return status;
}

static int set_hessian(Box *s, const real *P)
{
    int status = OK;
    s->head->apart = 0;
    s->head->definite = box_invert(s, P);
    if (!s->head->definite) {
        status = copy_checked(s, P);
        s->head->definite = status == OK && box_invert(s, NULL);
    }
    s->head->inverted = s->head->definite;
    return status != OK || s->head->definite ? status : box_regularise(s);
}

static int set_linear(Box *s, const real *q)
{
    memcpy(s->raw_q, q, (size_t)s->d * sizeof(real));
    return are_finite(s->raw_q, s->ld) ? OK : NOT_FINITE;
}

int box_set_data(Box *s, const real *P, const real *q)
{
    BoxHead *const head = s->head;
    head->of_P = P != NULL ? set_hessian(s, P) : head->of_P;
    head->of_q = q != NULL ? set_linear(s, q) : head->of_q;
    rescale(s);
    return P != NULL && head->of_P != OK ? head->of_P : q != NULL ? head->of_q : OK;
}

int box_start(Box *s, const real *x)
{
    if (!are_finite(x, s->d)) {
        return NOT_FINITE;
    }
    for (int j = 0; j < s->d; ++j) {
        s->answer[j] = x[j];
        s->side[j] = x[j] >= s->ub[j] ? UPPER : x[j] <= s->lb[j] ? LOWER : FREE;
    }
    return OK;
}

/* A variable apart goes to the bound that q points to or, if q is 0, stays as near as possible to the warm start or 0.
 * OK or UNBOUNDED. */
static int answer_apart(Box *s, int warm)
{
    for (int j = 0; j < s->d; ++j) {
        if (s->scale[j] == 0) {
            const real q = s->raw_q[j], lb = s->lb[j], ub = s->ub[j], near = warm ? s->answer[j] : 0;
            const real x = q > 0 ? lb : q < 0 ? ub : near < lb ? lb : near > ub ? ub : near;
            if (!(MAGNITUDE(x) < REAL_INFINITY)) {
                return UNBOUNDED;
            }
            s->answer[j] = x;
            s->side[j] = x == lb ? LOWER : x == ub ? UPPER : FREE;
        }
    }
    return OK;
}

static void write_answer(Box *s)
{
    const vec8 unit = splat(1 / s->head->root);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 scale = load(s->scale + b), x = mul(mul(mul(load(s->z + b), unit), unit), scale);
        const vec8 inside = clip(x, load(s->lb + b), load(s->ub + b));
        store(s->answer + b, where_less(zeros(), scale, inside, load(s->answer + b)));
    }
}

real box_gradient(const Box *s, int j)
{
    const real root = s->head->root;
    return s->scale[j] == 0 ? s->raw_q[j] : s->grad_z[j] / root / root / (s->head->cost * s->scale[j]);
}

real box_inverse_diagonal(const Box *s, int j)
{
    const real scale = s->scale[j];
    return s->head->definite ? MAGNITUDE(s->inverse_diagonal[j]) * s->head->cost * scale * scale : REAL_INFINITY;
}

static int solve_once(Box *s, Search *search, int warm)
{
    BoxHead *const head = s->head;
    int status = OK;
    head->refinements = 0;
    head->proximal_steps = 0;
    head->singular = !head->definite;
    if (head->definite) {
        head->inverted = head->inverted || box_invert(s, NULL);
        box_begin(s, search, warm);
        status = box_dual_active_set(s, search);
        if (status == BREAKDOWN) {
            head->inverted = 0;
            if (box_regularise(s) != OK) {
                return INDEFINITE;
            }
        }
    }
    return head->singular ? box_proximal_point(s, search, warm) : status;
}

static int has_answer(int status) { return status == OK || status == CAPPED; }

int box_solve(Box *s, int warm)
{
    BoxHead *const head = s->head;
    Search search = {.linear = s->q};
    int status = head->of_bounds != OK ? head->of_bounds : head->of_P != OK ? head->of_P : head->of_q;
    if (status != OK) {
        return status;
    }
    status = solve_once(s, &search, warm);
    if (warm && !has_answer(status)) { /* only the data decide whether there is one */
        search = (Search){.linear = s->q, .exchanges = head->cap > 0 ? search.exchanges : 0};
        status = solve_once(s, &search, 0);
    }
    head->exchanges = search.exchanges;
    write_answer(s);
    return head->apart && has_answer(status) && answer_apart(s, warm) != OK ? UNBOUNDED : status;
}

int box_solve_from(void *memory, int d, const real *P, const real *q, const real *lb, const real *ub, const real *x)
{
    box_setup(memory, d, lb, ub);
    Box s = box_at(memory);
    box_set_data(&s, P, q);
    return box_start(&s, x) == OK ? box_solve(&s, 1) : NOT_FINITE;
}
