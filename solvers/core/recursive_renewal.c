/* The swept Gram matrix made anew a little at each row, so that no row takes much longer than another.
 *
 * A copy of G + diag(rho) is swept on PIVOTS free variables a row. Each row that comes in the meantime changes it by
 * the same matrix of rank one as M, with the variables that it is swept on so far in the place of F (recursive_rows.c);
 * where the free variables change, so does what is left to sweep. When it is swept on F it takes the place of M before
 * the next row, and the answer, z and the gradient, is refined from where it was, mostly by one step. A pivot that is
 * no good begins the copy again with rho_j at least FLOOR G_jj. A variable that changes to its other bound changes the
 * sign of its row of G, and the copy is begun again, too.
 */
#include "recursive.h"

#define EARLY 1e3 /* `growth` from which M is made anew although it is young */
enum { PIVOTS = 2, REFINED = 4 };
enum { PLAIN = 1, FLOORED }; /* what `renewing` is */

/* The matrix being made, under the names of the one in use. */
static Recursive next_of(const Recursive *s, RecursiveHead *head)
{
    Recursive next = *s;
    *head = *s->head;
    head->free_count = s->head->next_count;
    head->growth = s->head->next_growth;
    next.head = head;
    next.M = s->next_M;
    next.free = s->next_free;
    next.rho = s->next_rho;
    next.centre = s->next_centre;
    next.list = s->next_list;
    return next;
}

static void begin(Recursive *s, int renewing)
{
    RecursiveHead head;
    Recursive next = next_of(s, &head);
    for (int b = 0; b < s->ld; b += LANES) {
        store(next.free + b, zeros());
        store(next.centre + b, mul(load(s->free + b), sub(zeros(), load(last_row(s) + b))));
    }
    recursive_complete(s, s->G);
    recursive_unswept(&next, renewing == FLOORED ? FLOOR : 0);
    s->head->renewing = renewing;
    s->head->next_count = 0;
    s->head->next_growth = renewing == FLOORED ? SPENT : 1;
}

static int due(const Recursive *s)
{
    return s->head->since_refresh + (s->head->free_count + 1) / PIVOTS + 2 >= RECURSIVE_REFRESH
           || (s->head->growth > EARLY && s->head->growth < SPENT);
}

void recursive_renew(Recursive *s, int exchanged)
{
    RecursiveHead head;
    Recursive next = next_of(s, &head);
    int pivots = exchanged ? 0 : PIVOTS; /* an exchange is a sweep of M */
    if (!s->head->renewing) {
        if (due(s)) {
            begin(s, PLAIN);
        }
        return;
    }
    if (!recursive_move(&next)) {
        s->head->renewing = 0;
        return;
    }
    for (int j = 0; j < s->d && pivots > 0; ++j) {
        if (next.free[j] != s->free[j]) {
            if (!(next.free[j] > 0 ? row_of(&next, next.M, j)[j] < 0 : recursive_definite(&next, j))) {
                if (s->head->renewing == PLAIN) {
                    begin(s, FLOORED);
                } else {
                    s->head->renewing = 0;
                }
                return;
            }
            recursive_sweep(&next, j);
            next.free[j] = s->free[j];
            --pivots;
        }
    }
    recursive_list_free(&next);
    s->head->next_count = head.free_count;
    s->head->next_growth = head.growth;
}

int recursive_use_renewed(Recursive *s)
{
    if (!s->head->renewing) {
        return 1;
    }
    for (int j = 0; j < s->d; ++j) {
        if (s->next_free[j] != s->free[j]) {
            return 1;
        }
    }
    memcpy(s->row, last_row(s), (size_t)s->ld * sizeof(real));
    memcpy(s->M, s->next_M, (size_t)(s->d + 1) * (size_t)s->ld * sizeof(real));
    for (int j = 0; j < s->d; ++j) {
        last_row(s)[j] = row_of(s, s->M, j)[s->d] = s->row[j];
    }
    memcpy(s->rho, s->next_rho, (size_t)s->ld * sizeof(real));
    memcpy(s->centre, s->next_centre, (size_t)s->ld * sizeof(real));
    s->head->growth = s->head->next_growth;
    s->head->since_refresh = s->head->renewing = 0;
    ++s->head->refreshes;
    for (int k = 0; k < REFINED; ++k) {
        if (recursive_tolerable(s, recursive_refine(s))) {
            return 1;
        }
    }
    return 0;
}
