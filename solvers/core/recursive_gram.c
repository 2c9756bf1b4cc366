/* The Gram matrix of data swept on the free variables of a box problem (recursive.h), and what moves it by a matrix of
 * low rank.
 *
 * Freeing or fixing variable j is one sweep, with p = M_jj,
 *
 *     M <- M - M[:, j] M[j, :] / p  off row and column j,    M_jk <- M_jk / |p|,    M_jj <- -1 / p.
 */
#include "recursive.h"

enum { RECURSIVE_VECTORS = 17 };

static int64_t cold_at(int d)
{
    const int64_t ld = padded(d + 1);
    return HEAD_BYTES + ld * (RECURSIVE_VECTORS + d + 4 + 3 * ld) * (int64_t)sizeof(real) + 2 * ld * 8;
}

int64_t recursive_bytes(int d) { return arena_bytes(cold_at(d)) + box_bytes(d); }

Recursive recursive_at(void *memory)
{
    Recursive s;
    Arena arena = after_head(memory);
    real **const names[RECURSIVE_VECTORS] = {&s.answer, &s.origin, &s.sign,      &s.width,    &s.lb,         &s.ub,
                                             &s.side,   &s.free,   &s.row,       &s.centre,   &s.rho,        &s.g,
                                             &s.root,   &s.q,      &s.next_free, &s.next_rho, &s.next_centre};
    s.head = memory;
    s.d = VARIABLES(s.head);
    s.ld = padded(s.d + 1);
    name_vectors(&arena, s.ld, names, RECURSIVE_VECTORS);
    s.list = integers(&arena, s.d + 1);
    s.next_list = integers(&arena, s.d + 1);
    s.u = reals(&arena, 4, s.ld);
    s.P = reals(&arena, s.d, s.ld);
    s.M = reals(&arena, s.ld, s.ld);
    s.G = reals(&arena, s.ld, s.ld);
    s.next_M = reals(&arena, s.ld, s.ld);
    s.cold = box_at((char *)memory + arena_bytes(cold_at(s.d)));
    return s;
}

int recursive_setup(void *memory, int d, const real *lb, const real *ub, double forgetting, double row_weight,
                    double proximal)
{
    const int64_t bytes = recursive_bytes(d), cold = arena_bytes(cold_at(d));
    Recursive s;
    int status;
    memset(memory, 0, (size_t)cold);
    status = box_setup((char *)memory + cold, d, lb, ub);
    s.head = memory;
    s.head->kind = RECURSIVE_KIND;
    s.head->d = d;
    s.head->bytes = bytes;
    s.head->forgetting = forgetting;
    s.head->root_growth = 1 / sqrt(forgetting);
    s.head->row_weight = row_weight;
    s.head->proximal = proximal;
    s = recursive_at(memory);
    for (int j = 0; j < d && status == OK; ++j) {
        s.lb[j] = lb[j] > -NO_BOUND ? lb[j] : -NO_BOUND;
        s.ub[j] = ub[j] < NO_BOUND ? ub[j] : NO_BOUND;
    }
    return status;
}

void recursive_list_free(Recursive *s)
{
    int count = 0;
    for (int j = 0; j < s->d; ++j) {
        if (s->free[j] > 0) {
            s->list[count] = j;
            ++count;
        }
    }
    s->head->free_count = count;
}

void recursive_subtract_free(const Recursive *s, const real *matrix, const real *share, real *out)
{
    const int ld = s->ld, count = s->head->free_count;
    const int32_t *const list = s->list;
    for (int b = 0; b < ld; b += LANES) {
        vec8 sum0 = load(out + b), sum1 = zeros(), sum2 = sum1, sum3 = sum1;
        int t = 0;
        for (; t + 3 < count; t += 4) {
            const int j0 = list[t], j1 = list[t + 1], j2 = list[t + 2], j3 = list[t + 3];
            sum0 = sub_mul(sum0, splat(share[j0]), load(matrix + (size_t)j0 * (size_t)ld + b));
            sum1 = sub_mul(sum1, splat(share[j1]), load(matrix + (size_t)j1 * (size_t)ld + b));
            sum2 = sub_mul(sum2, splat(share[j2]), load(matrix + (size_t)j2 * (size_t)ld + b));
            sum3 = sub_mul(sum3, splat(share[j3]), load(matrix + (size_t)j3 * (size_t)ld + b));
        }
        for (; t < count; ++t) {
            sum0 = sub_mul(sum0, splat(share[list[t]]), load(matrix + (size_t)list[t] * (size_t)ld + b));
        }
        store(out + b, add(add(sum0, sum1), add(sum2, sum3)));
    }
}

/* Fill in what is below the diagonal blocks. */
void recursive_complete(const Recursive *s, real *matrix)
{
    for (int i = LANES; i <= s->d; ++i) {
        for (int j = 0; j < i / LANES * LANES; ++j) {
            row_of(s, matrix, i)[j] = row_of(s, matrix, j)[i];
        }
    }
}

/* Keep row j at `u` and sweep it; 1/p. */
static real sweep_row(const Recursive *s, int j, real *u)
{
    real *const row = row_of(s, s->M, j);
    const real inverse = 1 / row[j];
    const vec8 scale = splat(MAGNITUDE(inverse));
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 value = load(row + b);
        store(u + b, value);
        store(row + b, mul(value, scale));
    }
    row[j] = -inverse;
    return inverse;
}

/* Bring row i up to a sweep on j, given row j from before it at `u` and 1/p. */
static void follow(const Recursive *s, int i, int j, const real *u, real inverse)
{
    real *const row = row_of(s, s->M, i);
    const real entry = u[i];
    const vec8 factor = splat(-entry * inverse);
    for (int b = 0; b < s->ld; b += LANES) {
        store(row + b, plus_product(load(row + b), factor, load(u + b)));
    }
    row[j] = entry * MAGNITUDE(inverse);
}

/* Whether variable j, not swept so far, has a pivot above its rounding; it is what of G_jj the variables in F do not
 * explain. */
int recursive_definite(const Recursive *s, int j)
{
    const real all_of_it = row_of(s, s->G, j)[j] + s->rho[j];
    return row_of(s, s->M, j)[j] > 5 * (real)s->d * REAL_EPSILON * all_of_it;
}

void recursive_sweep(Recursive *s, int j)
{
    const real inverse = sweep_row(s, j, s->u);
    for (int i = 0; i <= s->d; ++i) {
        if (i != j) {
            follow(s, i, j, s->u, inverse);
        }
    }
}

/* Sweep M, not swept so far, on all of F; 0 where G_FF is not positive definite to rounding.
 *
 * Four at a time, M <- M - sum w w' with w the row of a pivot over its root: M is then read and written a quarter as
 * often. The four rows follow each other sweep by sweep; the others, whose columns of the same numbers are these rows,
 * only above the diagonal. */
int recursive_sweep_free(Recursive *s)
{
    const int d = s->d, ld = s->ld, count = s->head->free_count;
    real *const u0 = s->u, *const u1 = u0 + ld, *const u2 = u1 + ld, *const u3 = u2 + ld;
    for (int t = 0; t < count; t += 4) {
        const int four = count - t < 4 ? count - t : 4;
        const int32_t *const chosen = s->list + t;
        memset(u0, 0, 4 * (size_t)ld * sizeof(real));
        for (int k = 0; k < four; ++k) {
            for (int i = 0; i < chosen[k] / LANES * LANES; ++i) {
                row_of(s, s->M, chosen[k])[i] = row_of(s, s->M, i)[chosen[k]];
            }
        }
        for (int k = 0; k < four; ++k) {
            real inverse;
            if (!recursive_definite(s, chosen[k])) {
                return 0;
            }
            inverse = sweep_row(s, chosen[k], u0 + k * ld);
            for (int r = 0; r < four; ++r) {
                if (r != k) {
                    follow(s, chosen[r], chosen[k], u0 + k * ld, inverse);
                }
            }
            s->root[k] = ROOT(inverse);
        }
        for (int k = 0; k < four; ++k) {
            real *const u = u0 + k * ld;
            for (int b = 0; b < ld; b += LANES) {
                store(u + b, mul(load(u + b), splat(s->root[k])));
            }
            for (int r = 0; r < four; ++r) {
                u[chosen[r]] = 0;
            }
        }
        for (int b = 0; b < ld; b += LANES) {
            const vec8 w0 = load(u0 + b), w1 = load(u1 + b), w2 = load(u2 + b), w3 = load(u3 + b);
            for (int i = 0; i < b + LANES && i <= d; ++i) {
                real *const at = row_of(s, s->M, i) + b;
                const vec8 value = sub_mul(sub_mul(load(at), w0, splat(u0[i])), w1, splat(u1[i]));
                store(at, sub_mul(sub_mul(value, w2, splat(u2[i])), w3, splat(u3[i])));
            }
        }
        for (int k = 0; k < four; ++k) {
            for (int i = 0; i <= d && i < chosen[k] / LANES * LANES + LANES; ++i) {
                row_of(s, s->M, i)[chosen[k]] = row_of(s, s->M, chosen[k])[i];
            }
        }
    }
    recursive_complete(s, s->M);
    return 1;
}
