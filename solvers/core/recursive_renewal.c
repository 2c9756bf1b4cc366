/* Refresh of the swept Gram matrix (recursive.h).
 *
 * Rounding errors of M grow with the rows added to it, up to a refresh by the rule in recursive_rows.c. G is only a sum
 * of rows and has errors of the last bits. So
 *
 *     G + diag(rho),    with the proximal term rho_j (z_j - c_j)^2/2 about the present z = c,
 *
 * is swept on the free variables, and its last row m, which is z and the gradient, is improved by steps of iterative
 * refinement from its present value:
 *
 *     m_A <- g_A,    m <- m - sum over j in F of g_j M[j, :],    g = q + (G + diag rho) z - diag(rho) c.
 *
 * Directions that the data do not determine thus keep their values. rho_j is `proximal` times G_jj or the mean diagonal
 * of G, whichever is less (the mean if G_jj = 0), so that variables on a large scale do not hold those on a small one.
 * If a pivot is still too small, z cannot be refined or the exchanges do not end, rho_j is raised to at least FLOOR
 * G_jj.
 *
 * Sources: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, chapter 12 (iterative refinement); R. T.
 * Rockafellar, SIAM J. Control Optim. 14 (1976) 877 (proximal point).
 */
#include "recursive.h"

#include "product.h"

enum { REFINED = 4 };       /* limit of refinement steps */
#define FLOOR ((real)1e-11) /* smallest rho_j/G_jj if G_FF is singular */
#define SPENT 1e5           /* initial `growth` in that case: the inverse has few digits to lose */
/* Relative to the cost, or to 1e-4 times the cost of z = 0: z is refined until a step gains less than RESOLVED, and
 * G_FF counts as singular if the last step gains more than TOLERATED. */
#define RESOLVED ((real)1e-24)
#define TOLERATED ((real)1e-14)
#ifdef CORE_FLOAT
#define UNSEEN 1e-30F /* rho_j of a variable that is zero in all data */
#else
#define UNSEEN 1e-200
#endif

void recursive_complete(const Recursive *s)
{
    for (int i = LANES; i <= s->d; ++i) {
        for (int j = 0; j < i / LANES * LANES; ++j) {
            row_of(s, s->G, i)[j] = row_of(s, s->G, j)[i];
        }
    }
}

/* Only the blocks of G from the diagonal on are read, each also as its transpose. */
void recursive_residual(const Recursive *s)
{
    real *const z = s->u;
    for (int b = 0; b < s->ld; b += LANES) {
        store(z + b, sub(zeros(), mul(load(s->is_free + b), load(last_row(s) + b))));
        store(s->g + b, mul(load(s->rho + b), sub(load(z + b), load(s->centre + b))));
    }
    z[s->d] = 1; /* q is the last column of G */
    for (int i = 0; i <= s->d; ++i) {
        const real *const row = row_of(s, s->G, i);
        const int own = i / LANES * LANES;
        const vec8 share = splat(z[i]);
        vec8 dot = zeros();
        store(s->g + own, plus_product(load(s->g + own), share, load(row + own)));
        for (int b = own + LANES; b < s->ld; b += LANES) {
            const vec8 entries = load(row + b);
            store(s->g + b, plus_product(load(s->g + b), share, entries));
            dot = plus_product(dot, load(z + b), entries);
        }
        s->g[i] += sum8(dot);
    }
}

/* One step of refinement; twice the decrease of the cost. */
static real refine_once(const Recursive *s)
{
    real *const last = last_row(s), gain = 0;
    recursive_residual(s);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 free = load(s->is_free + b), g = load(s->g + b);
        store(s->share + b, sub(zeros(), mul(free, g)));
        store(last + b, plus_product(mul(free, load(last + b)), sub(splat(1), free), g));
    }
    affine(s->M, s->ld, s->d, s->share, last, last);
    for (int j = 0; j < s->d; ++j) {
        real *const beside = row_of(s, s->M, j) + s->d;
        gain -= s->share[j] * (last[j] - *beside);
        *beside = last[j];
    }
    return gain;
}

/* Refine z; whether M is good enough for that. */
static int refine(const Recursive *s)
{
    const real *const cost = last_row(s) + s->d;
    const real least = (real)1e-4 * row_of(s, s->G, s->d)[s->d];
    real gain = REAL_INFINITY, scale = 0;
    for (int k = 0; k < REFINED && !(gain <= RESOLVED * scale); ++k) {
        gain = refine_once(s);
        scale = MAGNITUDE(*cost) > least ? MAGNITUDE(*cost) : least;
    }
    return gain <= TOLERATED * scale;
}

/* Make M = G + diag(rho) swept on F, about the present z, which is to be refined; 0 if a pivot is too small. */
static int make_anew(Recursive *s, int floored)
{
    const int d = s->d;
    const size_t vector = (size_t)s->ld * sizeof(real);
    int good = 1;
    real trace = 0;
    recursive_complete(s);
    for (int j = 0; j < d; ++j) {
        s->centre[j] = -s->is_free[j] * last_row(s)[j];
        trace += row_of(s, s->G, j)[j];
    }
    memcpy(s->M, s->G, (size_t)(d + 1) * vector);
    for (int j = 0; j < d; ++j) {
        const real diagonal = row_of(s, s->G, j)[j], mean = trace / (real)d;
        const real rho = (real)s->head->proximal * (diagonal > 0 && diagonal < mean ? diagonal : mean);
        const real floor = FLOOR * diagonal > UNSEEN ? FLOOR * diagonal : UNSEEN;
        s->rho[j] = floored && !(rho > floor) ? floor : rho;
        row_of(s, s->M, j)[j] += s->rho[j];
        row_of(s, s->M, j)[d] -= s->rho[j] * s->centre[j];
        row_of(s, s->M, d)[j] -= s->rho[j] * s->centre[j];
    }
    memcpy(s->share, s->is_free, vector);
    memset(s->is_free, 0, vector);
    for (int j = 0; good && j < d; ++j) {
        good = !(s->share[j] > 0) || recursive_sweep(s, j);
    }
    memcpy(s->is_free, s->share, vector);
    for (int j = 0; j < d; ++j) {
        last_row(s)[j] = row_of(s, s->M, j)[d] = -s->centre[j];
    }
    s->head->growth = floored ? SPENT : 1;
    s->head->since_refresh = 0;
    ++s->head->refreshes;
    return good;
}

int recursive_refresh(Recursive *s)
{
    int status = SINGULAR;
    for (int floored = 0; floored <= 1 && status != OK && status != CAPPED; ++floored) {
        uint32_t exchanges = s->head->exchanges - 1;
        status = make_anew(s, floored) ? OK : SINGULAR;
        while (status == OK && exchanges != s->head->exchanges) {
            exchanges = s->head->exchanges;
            status = refine(s) || floored ? recursive_exchange(s) : SINGULAR;
        }
        for (int j = 0; status != OK && status != CAPPED && j < s->d; ++j) {
            last_row(s)[j] = -s->centre[j]; /* back to the initial z */
        }
    }
    return status;
}
