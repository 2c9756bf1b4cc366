/* The state of the recursive solver (recursive.h), its start, and its distance from the optimum.
 *
 * Every start is a cold exact solve, which detects unbounded problems; M is computed with the next row. If the
 * exchanges on M do not end, recursive_recover starts again from P and q, which it computes from G. Errors remain only
 * for problems without a minimum: unbounded, or P indefinite.
 */
#include "recursive.h"

enum { RECURSIVE_VECTORS = 15 };

static int64_t cold_at(int d)
{
    const int64_t ld = padded(d + 1), numbers = ld * (RECURSIVE_VECTORS + d + 2 * ld);
    return arena_bytes(HEAD_BYTES + numbers * (int64_t)sizeof(real));
}

int64_t recursive_bytes(int d) { return cold_at(d) + box_bytes(d); }

Recursive recursive_at(void *memory)
{
    const int d = VARIABLES((const RecursiveHead *)memory);
    Recursive s = {.head = memory, .d = d, .ld = padded(d + 1)};
    Arena arena = after_head(memory);
    const Extent extents[] = {{&s.answer, s.ld}, {&s.origin, s.ld},   {&s.sign, s.ld},    {&s.width, s.ld},
                              {&s.lb, s.ld},     {&s.ub, s.ld},       {&s.side, s.ld},    {&s.row, s.ld},
                              {&s.g, s.ld},      {&s.u, s.ld},        {&s.q, s.ld},       {&s.share, s.ld},
                              {&s.P, d * s.ld},  {&s.G, s.ld * s.ld}, {&s.is_free, s.ld}, {&s.rho, s.ld},
                              {&s.centre, s.ld}, {&s.M, s.ld * s.ld}};
    LAY_OUT(&arena, extents);
    s.cold = box_at((char *)memory + cold_at(s.d));
    return s;
}

int recursive_setup(void *memory, int d, const real *lb, const real *ub, double forgetting, double row_weight,
                    double proximal)
{
    RecursiveHead *const head = memory;
    new_state(memory, RECURSIVE_KIND, d, recursive_bytes(d));
    head->forgetting = forgetting;
    head->root_growth = 1 / sqrt(forgetting);
    head->row_weight = row_weight;
    head->proximal = proximal;
    const int status = box_setup((char *)memory + cold_at(d), d, lb, ub);
    const Recursive s = recursive_at(memory);
    for (int j = 0; j < d && status == OK; ++j) {
        s.lb[j] = lb[j] > -NO_BOUND ? lb[j] : -NO_BOUND;
        s.ub[j] = ub[j] < NO_BOUND ? ub[j] : NO_BOUND;
    }
    return status;
}

/* Set variable j as the cold solver left it: the bound from which z is measured, and z if j is free. */
static void place_variable(const Recursive *s, int j)
{
    const real lb = s->lb[j], ub = s->ub[j];
    const int side = s->cold.side[j], is_free = side == FREE && lb < ub;
    const int lower = lb > -NO_BOUND, upper = ub < NO_BOUND, from_above = upper && (side == UPPER || !lower);
    s->origin[j] = from_above ? ub : lower ? lb : 0;
    s->sign[j] = from_above ? -1 : 1;
    s->width[j] = lower && upper ? ub - lb : NO_BOUND;
    s->is_free[j] = is_free ? 1 : 0;
    s->side[j] = !((lower || upper) && lb < ub) ? 0 : is_free ? -1 : 1;
    last_row(s)[j] = is_free ? s->sign[j] * (s->origin[j] - s->cold.answer[j]) : 0;
}

/* Solve a problem by the cold solver. */
static int solve_cold(Recursive *s, const real *P, const real *q, int warm)
{
    const int status = box_set_data(&s->cold, P, q);
    if (status == OK && warm && box_start(&s->cold, s->answer) == OK && box_solve(&s->cold, 1) == OK) {
        return OK;
    }
    return status != OK ? status : box_solve(&s->cold, 0);
}

int recursive_begin(Recursive *s, const real *P, const real *q, real constant, int warm)
{
    const int d = s->d, status = solve_cold(s, P, q, warm);
    if (status != OK) {
        return status;
    }
    memset(s->is_free, 0, (size_t)(s->ld + 3) * (size_t)s->ld * sizeof(real)); /* and rho, centre and M */
    for (int j = 0; j < d; ++j) {
        place_variable(s, j);
    }
    for (int i = 0; i < d; ++i) {
        real *const row = row_of(s, s->G, i), shifted = q[i];
        for (int j = 0; j < d; ++j) {
            shifted += P[i * d + j] * s->origin[j];
            row[j] = s->sign[i] * ((P[i * d + j] + P[j * d + i]) / 2) * s->sign[j];
        }
        row[d] = row_of(s, s->G, d)[i] = s->sign[i] * shifted;
        constant += s->origin[i] * (q[i] + shifted);
    }
    row_of(s, s->G, d)[d] = constant;
    recursive_residual(s);
    for (int j = 0; j < d; ++j) {
        last_row(s)[j] = s->is_free[j] > 0 ? last_row(s)[j] : s->g[j];
    }
    s->head->root_weight = sqrt(s->head->row_weight);
    s->head->since_refresh = RECURSIVE_REFRESH; /* the next row computes M */
    return OK;
}

int recursive_recover(Recursive *s)
{
    const int d = s->d;
    /* the next row enters with its own weight */
    const real decay = (real)(s->head->row_weight / (s->head->root_weight * s->head->root_weight));
    real constant = decay * row_of(s, s->G, d)[d];
    recursive_complete(s);
    for (int i = 0; i < d; ++i) {
        const real *const row = row_of(s, s->G, i);
        s->q[i] = decay * s->sign[i] * row[d];
        constant -= s->origin[i] * s->q[i];
        for (int j = 0; j < d; ++j) {
            s->P[i * d + j] = decay * s->sign[i] * row[j] * s->sign[j];
            s->q[i] -= s->P[i * d + j] * s->origin[j];
        }
        constant -= s->origin[i] * s->q[i];
    }
    ++s->head->cold_starts;
    return recursive_begin(s, s->P, s->q, constant, 1);
}

real recursive_error(Recursive *s)
{
    const real *const last = last_row(s), *const q = row_of(s, s->G, s->d);
    real worst = 0;
    recursive_complete(s);
    /* z clipped as in the answer; it has a bound at zero unless `side` is zero */
    for (int j = 0; j < s->d; ++j) {
        const real z = -s->is_free[j] * last[j], up = z < 0 && (s->side[j] != 0 || s->width[j] < NO_BOUND) ? 0 : z;
        s->u[j] = up > s->width[j] ? s->width[j] : up;
    }
    for (int i = 0; i < s->d; ++i) {
        const real *const row = row_of(s, s->G, i);
        const real z = s->u[i];
        real g = q[i] + s->rho[i] * (z - s->centre[i]), size = MAGNITUDE(q[i]);
        for (int j = 0; j < s->d; ++j) {
            g += row[j] * s->u[j];
            size += MAGNITUDE(row[j] * s->u[j]);
        }
        const int held = s->width[i] == 0 || (z == 0 && s->side[i] != 0 && g > 0) || (z == s->width[i] && g < 0);
        const real wrong = held ? g - g : MAGNITUDE(g);
        worst = wrong <= worst * size ? worst : wrong / size; /* also for NaN */
    }
    return worst;
}
