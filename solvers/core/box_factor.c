/* P_FF = L D L' of the free variables of a box problem, and the Newton step that every method on it repeats.
 *
 * With F free and A at a bound, P_FF s = -g_F, x_F <- x_F + s, g = q + P x. Since it starts from the current x, a second step on the
 * same set is a step of iterative refinement, and rounding of earlier sets does not pile up. The factor stays while the set does.
 *
 * Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., sections 4.1 and 4.2.
 */
#include "box.h"

#include "product.h"

/* By places in the list: the rows of V are those of D L', the rows of L those of L. */
real box_factorise(Box *s)
{
    const int n = s->head->free_count, ld = s->ld;
    real smallest = REAL_INFINITY;
    for (int i = 0; i < n; ++i) {
        const real *const row = s->P + (size_t)s->list[i] * (size_t)ld;
        real *const to = s->V + (size_t)i * (size_t)ld;
        for (int j = i; j < n; ++j) {
            to[j] = row[s->list[j]];
        }
        for (int j = n; j < ld; ++j) {
            to[j] = 0;
        }
    }
    s->head->factor_fits = 0;
    for (int k = 0; k < n; ++k) {
        const real *const pivot_row = s->V + (size_t)k * (size_t)ld;
        const real pivot = pivot_row[k], inverse = 1 / pivot;
        if (!(MAGNITUDE(pivot) < REAL_INFINITY)) {
            return -REAL_INFINITY;
        }
        smallest = pivot < smallest ? pivot : smallest;
        for (int i = k + 1; i < n; ++i) {
            const real multiplier = pivot_row[i] * inverse;
            real *const row = s->V + (size_t)i * (size_t)ld;
            s->L[(size_t)i * (size_t)ld + (size_t)k] = multiplier;
            for (int b = i / LANES * LANES; b < n; b += LANES) { /* what is left of the diagonal is not read again */
                store(row + b, less_product(load(row + b), splat(multiplier), load(pivot_row + b)));
            }
        }
    }
    s->head->factor_fits = 1;
    return smallest;
}

void box_back_solve(const Box *s, real *right)
{
    const int n = s->head->free_count, ld = s->ld;
    for (int k = 0; k < n; ++k) {
        const real *const row = s->V + (size_t)k * (size_t)ld;
        const real solved = right[k] / row[k];
        for (int j = k + 1; j < n; ++j) {
            right[j] -= row[j] * solved;
        }
        right[k] = solved;
    }
    for (int i = n - 1; i > 0; --i) {
        const real *const row = s->L + (size_t)i * (size_t)ld;
        for (int k = 0; k < i; ++k) {
            right[k] -= row[k] * right[i];
        }
    }
}

/* Move x_F to the minimiser with x_A held, and g with it; 0 where P_FF is not positive definite to rounding. */
int box_newton(Box *s)
{
    const int n = s->head->free_count;
    ++s->head->systems;
    if (!s->head->factor_fits && !(box_factorise(s) > 0)) {
        s->head->factor_fits = 0;
        return 0;
    }
    for (int k = 0; k < n; ++k) {
        s->step[k] = -s->g[s->list[k]];
    }
    box_back_solve(s, s->step);
    for (int k = 0; k < n; ++k) {
        s->x[s->list[k]] += s->step[k];
    }
    box_gradient(s);
    return 1;
}

/* List the free variables in ascending order; the factor fits on where they are those of the list before. */
void box_list_free(Box *s)
{
    int count = 0, same = 1;
    for (int j = 0; j < s->d; ++j) {
        if (s->side[j] == FREE) {
            same &= count < s->head->free_count && s->list[count] == j;
            s->list[count] = j;
            ++count;
        }
    }
    s->head->factor_fits &= same && count == s->head->free_count;
    s->head->free_count = count;
}

/* Change the side of variable j; to a bound, x_j goes there and g follows. */
void box_move(Box *s, int j, int side)
{
    s->side[j] = side;
    if (side != FREE) {
        const real bound = side == LOWER ? s->lo[j] : s->hi[j];
        const real *const row = s->P + (size_t)j * (size_t)s->ld;
        const vec8 change = splat(bound - s->x[j]);
        s->x[j] = bound;
        for (int b = 0; b < s->ld; b += LANES) {
            store(s->g + b, plus_product(load(s->g + b), load(row + b), change));
        }
    }
}

/* What rounding may leave of an entry of g that is zero: 4 d eps max(|q|, |x|) in scaled variables. */
real box_gradient_tolerance(const Box *s)
{
    vec8 largest = zeros();
    for (int b = 0; b < s->ld; b += LANES) {
        largest = larger(larger(magnitude(load(s->q + b)), magnitude(load(s->x + b))), largest);
    }
    return 4 * (real)s->d * REAL_EPSILON * largest8(largest);
}

void box_gradient(Box *s) { affine(s->P, s->ld, s->d, s->x, s->q, s->g); }
