/* The swept Gram matrix (recursive.h) made anew, a little at each row, so that no row takes much longer than another,
 * or at once.
 *
 * Rounding errors of M grow with the rows added to it (recursive_rows.c says when they are not let grow further). G, to
 * which rows are added and nothing else, has errors of its last bits only. So a copy of
 *
 *     G + diag(rho),    rho_j (z_j - c_j)^2/2 the proximal term about c, the z of now,
 *
 * is swept on some free variables at each row. Each row that comes in the meantime changes it by the same matrix of
 * rank one as M, with the variables that it is swept on so far in the place of F; where the free variables change, so
 * does what is left to sweep. When it is swept on F it takes the place of M before the next row, and its last row m,
 * which is z and the gradient, takes steps of iterative refinement from where it was:
 *
 *     m_A <- g_A,    m <- m - sum over j in F of g_j M[j, :],    g = q + (G + diag rho) z - diag(rho) c.
 *
 * What the data do not determine thus stays where it is. rho_j is `proximal` times G_jj, at most the mean diagonal of
 * G, and that where G_jj = 0: a variable on a large scale must not hold those on a small one. Where a pivot is no good
 * even so, or at once where z cannot be refined or the exchanges afterwards do not end, the copy begins again with
 * rho_j at least FLOOR G_jj. A variable that changes to its other bound changes the sign of its row of G, and the copy
 * is begun again, too.
 *
 * Sources: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, chapter 12 (iterative refinement); R. T.
 * Rockafellar, SIAM J. Control Optim. 14 (1976) 877 (proximal point).
 */
#include "recursive.h"

#include "product.h"

enum { PLAIN = 1, FLOORED }; /* what `renewing` is */
enum { REFINED = 4 };        /* steps of refinement at most */
enum { LEAD = 3 };           /* rows by which a copy is begun before all its pivots need it */
#define FLOOR ((real)1e-11)  /* of rho_j/G_jj where G_FF is singular */
#define SPENT 1e5            /* what `growth` begins with there: the inverse has few digits to lose */
#define EARLY 1e3            /* `growth` from which M is made anew although it is young */
/* Shares of the cost, or of 1e-4 of what z = 0 costs: G_FF counts as singular where a step of refinement still gains
 * more than TOLERATED; at once, where no row waits for it, z is refined until it gains less than RESOLVED. */
#define RESOLVED ((real)1e-24)
#define TOLERATED ((real)1e-14)
#ifdef CORE_FLOAT
#define UNSEEN 1e-30F /* rho_j where the data say nothing on variable j, whatever their scale */
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

/* The blocks of G from the diagonal on are read, each for its transpose, too. */
void recursive_residual(const Recursive *s)
{
    const Swept *const m = &s->now;
    real *const z = s->u;
    for (int b = 0; b < s->ld; b += LANES) {
        store(z + b, sub(zeros(), mul(load(m->free + b), load(last_row(s) + b))));
        store(s->g + b, mul(load(m->rho + b), sub(load(z + b), load(m->centre + b))));
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

/* One step of refinement; twice what it lowers the cost by. */
static real refine_once(const Recursive *s)
{
    const Swept *const m = &s->now;
    real *const last = last_row(s), gain = 0;
    recursive_residual(s);
    for (int b = 0; b < s->ld; b += LANES) {
        const vec8 free = load(m->free + b), g = load(s->g + b);
        store(s->share + b, sub(zeros(), mul(free, g)));
        store(last + b, plus_product(mul(free, load(last + b)), sub(splat(1), free), g));
    }
    affine(m->M, s->ld, s->d, s->share, last, last);
    for (int j = 0; j < s->d; ++j) {
        real *const beside = row_of(s, m->M, j) + s->d;
        gain -= s->share[j] * (last[j] - *beside);
        *beside = last[j];
    }
    return gain;
}

/* Refine z until a step gains less than `share` of the cost; whether M is good enough for that. */
static int refine(const Recursive *s, real share)
{
    const real *const cost = last_row(s) + s->d;
    const real least = (real)1e-4 * row_of(s, s->G, s->d)[s->d];
    real gain = REAL_INFINITY, scale = 0;
    for (int k = 0; k < REFINED && !(gain <= share * scale); ++k) {
        gain = refine_once(s);
        scale = MAGNITUDE(*cost) > least ? MAGNITUDE(*cost) : least;
    }
    return gain <= TOLERATED * scale;
}

/* Begin with G + diag(rho), swept on nothing, and q - rho c. */
static void begin(Recursive *s, int renewing)
{
    const Swept *const m = &s->next;
    const int d = s->d;
    real trace = 0;
    recursive_complete(s);
    memcpy(m->M, s->G, (size_t)(d + 1) * (size_t)s->ld * sizeof(real));
    for (int j = 0; j < d; ++j) {
        trace += row_of(s, s->G, j)[j];
    }
    for (int j = 0; j < d; ++j) {
        const real diagonal = row_of(s, s->G, j)[j], mean = trace / (real)d;
        const real rho = (real)s->head->proximal * (diagonal > 0 && diagonal < mean ? diagonal : mean);
        const real floor = FLOOR * diagonal > UNSEEN ? FLOOR * diagonal : UNSEEN;
        m->free[j] = 0;
        m->centre[j] = -s->now.free[j] * last_row(s)[j];
        m->rho[j] = renewing == FLOORED && !(rho > floor) ? floor : rho;
        row_of(s, m->M, j)[j] += m->rho[j];
        row_of(s, m->M, j)[d] -= m->rho[j] * m->centre[j];
        row_of(s, m->M, d)[j] -= m->rho[j] * m->centre[j];
    }
    s->head->renewing = renewing;
    *m->growth = renewing == FLOORED ? SPENT : 1;
}

/* Sweep on as many of the variables that are left; 0 where a pivot is no good. */
static int sweep_left(const Recursive *s, int pivots)
{
    for (int j = 0; j < s->d && pivots > 0; ++j) {
        if (s->next.free[j] != s->now.free[j]) {
            if (!recursive_sweep(s, &s->next, j)) {
                return 0;
            }
            --pivots;
        }
    }
    return 1;
}

/* The copy takes the place of M, about the z of now, which is to be refined. */
static void use(Recursive *s)
{
    const size_t all = (size_t)(s->ld + 3) * (size_t)s->ld * sizeof(real); /* of M, free, rho and centre */
    memcpy(s->u, last_row(s), (size_t)s->ld * sizeof(real));
    memcpy(s->now.M, s->next.M, all);
    for (int j = 0; j < s->d; ++j) {
        last_row(s)[j] = row_of(s, s->now.M, j)[s->d] = s->u[j];
    }
    s->head->growth = s->head->next_growth;
    s->head->since_refresh = s->head->renewing = 0;
    ++s->head->refreshes;
}

int recursive_use_renewed(Recursive *s)
{
    if (!s->head->renewing) {
        return 1;
    }
    for (int j = 0; j < s->d; ++j) {
        if (s->next.free[j] != s->now.free[j]) {
            return 1;
        }
    }
    use(s);
    return refine(s, TOLERATED);
}

void recursive_renew(Recursive *s, int pivots)
{
    const int row = s->head->since_refresh + s->d / RECURSIVE_PIVOTS + LEAD; /* at which it would be there */
    if (!s->head->renewing) {
        if (row >= RECURSIVE_REFRESH || (s->head->growth > EARLY && s->head->growth < SPENT)) {
            begin(s, PLAIN);
        }
    } else if (!recursive_move(s, &s->next)) {
        s->head->renewing = 0;
    } else if (!sweep_left(s, pivots)) {
        begin(s, FLOORED);
    }
}

int recursive_refresh(Recursive *s)
{
    int status = SINGULAR;
    for (int renewing = PLAIN; renewing <= FLOORED; ++renewing) {
        uint32_t exchanges;
        begin(s, renewing);
        if (!sweep_left(s, s->d)) {
            continue;
        }
        use(s);
        do {
            exchanges = s->head->exchanges;
            status = refine(s, RESOLVED) || renewing == FLOORED ? recursive_exchange(s) : SINGULAR;
        } while (status == OK && exchanges != s->head->exchanges);
        if (status == OK || status == CAPPED) {
            return status;
        }
        for (int j = 0; j < s->d; ++j) {
            last_row(s)[j] = -s->now.centre[j]; /* back to the z that it began with */
        }
    }
    return status;
}
