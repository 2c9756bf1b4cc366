/* The projected difference equation w(k+1) = Proj(w(k) - eta (P w(k) + q)) for a box, and the data of every gradient
 * method.
 *
 * It is the paper's discretisation of a projected dynamical system (equation (7)), the gradient projection method of
 * Goldstein (Bull. Amer. Math. Soc. 70 (1964) 709) and Levitin & Polyak (USSR Comput. Math. 6 (1966) 1). Why 0 < eta <
 * 2/lambda_max(P): the projection does not lengthen differences, and I - eta P shrinks them iff every |1 - eta lambda|
 * < 1; on a free direction with eta lambda > 2 the error grows by |1 - eta lambda| each step. Near the answer the
 * slowest free direction shrinks by 1 - eta lambda_min(P_FF), which is why condition 1e8 needs 1e8 steps.
 *
 * P is kept by columns, multiplied by -eta: one step at d = 18 is 54 products and sums of eight numbers and a clip.
 */
#include "descent.h"

#include "product.h"
#include "symmetric.h"

enum { VECTORS = 12, LOOK_EVERY = 16, POWERS = 16, GROWTH = 8 };
#define WITHOUT_TOLERANCE ((real)1e-9)
#define APART ((real)1e-3)            /* of lambda_max from its bound, relative: a step length needs no more */
#define INDEFINITE_SHARE ((real)1e-9) /* largest |negative eigenvalue| due to rounding, relative to lambda_max */

int64_t descent_bytes(int d) { return HEAD_BYTES + (int64_t)padded(d) * (VECTORS + 2 * d) * (int64_t)sizeof(real); }

ProjectedGradient descent_at(void *memory)
{
    const int d = VARIABLES((const ProjectedGradientHead *)memory);
    ProjectedGradient s = {.head = memory, .d = d, .ld = padded(d)};
    Arena arena = after_head(memory);
    const ArenaField fields[] = {{&s.w, s.ld},           {&s.next, s.ld},    {&s.shift, s.ld},    {&s.carry, s.ld},
                                 {&s.lower, s.ld},       {&s.upper, s.ld},   {&s.momentum, s.ld}, {&s.D, s.ld},
                                 {&s.lb, s.ld},          {&s.ub, s.ld},      {&s.q, s.ld},        {&s.answer, s.ld},
                                 {&s.columns, d * s.ld}, {&s.copy, d * s.ld}};
    LAY_OUT(&arena, fields);
    return s;
}

int descent_setup(void *memory, int d, const real *lb, const real *ub)
{
    new_state(memory, DESCENT_KIND, d, descent_bytes(d));
    const ProjectedGradient s = descent_at(memory);
    s.head->eta = 1;
    for (int j = 0; j < d; ++j) {
        s.lb[j] = s.lower[j] = lb[j];
        s.ub[j] = s.upper[j] = ub[j];
        s.D[j] = 1;
    }
    return status_of_bounds(d, lb, ub);
}

/* Whether shift I + sign A is positive definite, A in `columns`: every pivot of its elimination is positive. */
static int is_definite_with(const ProjectedGradient *s, real shift, real sign)
{
    const int d = s->d, ld = s->ld;
    for (int i = 0; i < d * ld; i += LANES) {
        store(s->copy + i, mul(splat(sign), load(s->columns + i)));
    }
    for (int j = 0; j < d; ++j) {
        real *const row = s->copy + j * ld;
        row[j] += shift;
        if (!(row[j] > 0)) {
            return 0;
        }
        for (int i = j + 1; i < d; ++i) {
            const vec8 factor = splat(row[i] / row[j]);
            for (int b = i / LANES * LANES; b < ld; b += LANES) { /* the upper triangle is enough */
                store(s->copy + i * ld + b, sub_mul(load(s->copy + i * ld + b), factor, load(row + b)));
            }
        }
    }
    return 1;
}

/* A lower bound of the largest eigenvalue of A in `columns`, the Rayleigh quotient after some power iterations from the
 * vector in `next`, of which `most` is the largest |entry|; 0 if that is negative. */
static real rayleigh_quotient(const ProjectedGradient *s, real most)
{
    real *const v = s->shift, *const image = s->next;
    real entry = most, product = 0, square = 0;
    memset(s->carry, 0, (size_t)s->ld * sizeof(real));
    for (int k = 0; k < POWERS && entry > 0; ++k) {
        for (int j = 0; j < s->d; ++j) {
            v[j] = image[j] / entry;
        }
        affine(s->columns, s->ld, s->d, v, s->carry, image);
        entry = largest_entry(image, s->ld);
    }
    for (int j = 0; j < s->d; ++j) {
        product += v[j] * image[j];
        square += v[j] * v[j];
    }
    return product > 0 ? product / square : 0;
}

/* An upper bound of the largest eigenvalue of A in `columns`, closer than a thousandth if that is positive. It is
 * between the Rayleigh quotient and the largest sum of |entries| of a row (Gershgorin), and above it are those x for
 * which x I - A is positive definite: steps that grow from the quotient, and then bisection. Infinite if such a sum is.
 */
static real largest_eigenvalue(const ProjectedGradient *s)
{
    real low = 0, high = 0;
    for (int j = 0; j < s->d; ++j) {
        const real *const row = s->columns + j * s->ld;
        real sum = 0;
        for (int i = 0; i < s->d; ++i) {
            sum += MAGNITUDE(row[i]);
        }
        s->next[j] = sum;
        low = row[j] > low ? row[j] : low;
        high = sum > high ? sum : high;
    }
    if (high < REAL_INFINITY) {
        const real quotient = rayleigh_quotient(s, high);
        low = quotient > low ? quotient : low;
    }
    for (real reach = APART * (low > 0 ? low : high); high - low > APART * high; reach *= GROWTH) {
        const real half = low + (high - low) / 2, near = low + reach, x = near < half ? near : half;
        if (!(low < x)) { /* there is no number between */
            break;
        }
        *(is_definite_with(s, x, -1) ? &high : &low) = x;
    }
    return high;
}

int descent_set_data(const ProjectedGradient *s, const real *P, const real *q, real ratio, int scaled)
{
    const int d = s->d, ld = s->ld;
    if (q != NULL) {
        if (!are_finite(q, d)) {
            return NOT_FINITE;
        }
        memcpy(s->q, q, (size_t)d * sizeof(real));
    }
    if (P != NULL) {
        real most = 0;
        for (int j = 0; j < d; ++j) {
            most = P[j * d + j] > most ? P[j * d + j] : most;
        }
        for (int j = 0; j < d; ++j) { /* a variable without a cost of its own has the scale of the data, too */
            const real diagonal = P[j * d + j] > 0 ? P[j * d + j] : most;
            s->D[j] = scaled && diagonal > 0 ? 1 / ROOT(diagonal) : 1;
        }
        const int status = scaled_symmetric(P, d, ld, s->D, s->copy);
        if (status != OK) {
            return status;
        }
        memcpy(s->columns, s->copy, (size_t)d * (size_t)ld * sizeof(real));
        const real largest = largest_eigenvalue(s);
        if (!(largest < REAL_INFINITY)) {
            return NOT_FINITE;
        }
        if (largest > 0 && !is_definite_with(s, INDEFINITE_SHARE * largest, 1)) {
            return INDEFINITE;
        }
        const real eta = largest > 0 ? 2 * ratio / largest : 1;
        s->head->eta = (double)eta;
        for (int j = 0; j < d; ++j) {
            for (int i = 0; i < ld; i += LANES) {
                store(s->columns + j * ld + i, mul(splat(-eta), load(s->columns + j * ld + i)));
            }
            s->lower[j] = s->lb[j] / s->D[j];
            s->upper[j] = s->ub[j] / s->D[j];
        }
    }
    for (int j = 0; j < d; ++j) {
        s->shift[j] = -(real)s->head->eta * (s->q[j] * s->D[j]);
    }
    return OK;
}

/* Move to the projection of the next point. */
static void go_to_next(const ProjectedGradient *s)
{
    for (int j = 0; j < s->ld; j += LANES) {
        const vec8 w = clip(load(s->next + j), load(s->lower + j), load(s->upper + j));
        store(s->w + j, w);
        store(s->carry + j, add(w, load(s->shift + j)));
    }
}

void descent_start(const ProjectedGradient *s, const real *x)
{
    for (int j = 0; j < s->d; ++j) {
        s->next[j] = x != NULL ? x[j] / s->D[j] : 0;
    }
    go_to_next(s);
}

/* Whether the projected gradient at w is within the threshold, but for the rounding of its terms. Steps tell less:
 * where w is large and P flat, they end by the rounding of w. */
static int is_met(const ProjectedGradient *s)
{
    vec8 total = zeros(), unit = splat((real)s->head->unit);
    for (int b = 0; b < s->ld; b += LANES) {
        vec8 w = load(s->w + b), step = load(s->shift + b), terms = magnitude(step);
        for (int j = 0; j < s->d; ++j) {
            const vec8 term = mul(load(s->columns + j * s->ld + b), splat(s->w[j]));
            step = add(step, term);
            terms = add(terms, magnitude(term));
        }
        step = magnitude(clip(step, sub(load(s->lower + b), w), sub(load(s->upper + b), w)));
        step = maximum(sub_mul(step, terms, splat((real)s->d * REAL_EPSILON)), zeros());
        total = plus_product(total, mul(step, unit), mul(step, unit));
    }
    return sum8(total) <= (real)s->head->threshold;
}

void descent_answer(const ProjectedGradient *s)
{
    for (int j = 0; j < s->d; ++j) {
        const real x = s->w[j] * s->D[j], up = x > s->lb[j] ? x : s->lb[j], inside = up < s->ub[j] ? up : s->ub[j];
        /* A bound divided and multiplied by D may differ in the last bit. */
        s->answer[j] = s->w[j] >= s->upper[j] ? s->ub[j] : s->w[j] <= s->lower[j] ? s->lb[j] : inside;
    }
    s->head->met = is_met(s);
}

/* If tolerance >= 0, every sixteenth step tests whether the projected gradient (w - Proj(w - eta (P w + q)))/eta is at
 * most tolerance |q| (2-norms), and ends the run if it is. Without a tolerance, the answer is judged by
 * WITHOUT_TOLERANCE. */
int64_t projected_steps(const ProjectedGradient *s, int64_t steps, real tolerance)
{
    const real sought = tolerance >= 0 ? tolerance : WITHOUT_TOLERANCE;
    const real unit = 1 / power_below(largest_entry(s->shift, s->ld));
    int64_t k = 0;
    s->head->unit = unit;
    s->head->threshold = sought * sought * length_squared(s->shift, unit, s->ld);
    while (k < steps && !(tolerance >= 0 && k > 0 && k % LOOK_EVERY == 0 && is_met(s))) {
        affine(s->columns, s->ld, s->d, s->w, s->carry, s->next);
        go_to_next(s);
        ++k;
    }
    s->head->steps = k;
    return k;
}
