/* With A x <= b the projection argmin 1/2 |x - v|^2 of v has the dual
 *
 *     minimise 1/2 l'(A A') l - l'(A v - b)  over  l >= 0,    x = v - A'l
 *
 * (Boyd & Vandenberghe, Convex Optimization, section 5.2.4), a box problem of a few variables that begins with the active set of the
 * projection before. Rows that depend on each other make A A' singular, which the box solver's proximal rule takes.
 */
#include "cone.h"

int64_t cone_bytes(int rows, int coupled)
{
    const int64_t own = HEAD_BYTES + (int64_t)padded(rows) * (coupled + 3) * (int64_t)sizeof(real) + (int64_t)padded(coupled) * 8;
    return room_bytes(own) + box_bytes(rows);
}

Cone cone_at(void *memory)
{
    Cone s;
    Room room = after_head(memory);
    s.head = memory;
    s.rows = s.head->rows;
    s.coupled = s.head->d;
    s.A = reals(&room, padded(s.rows), s.coupled);
    s.b = reals(&room, 1, padded(s.rows));
    s.slack = reals(&room, 1, padded(s.rows));
    s.zero = reals(&room, 1, padded(s.rows));
    s.index = integers(&room, s.coupled);
    s.dual = box_at((char *)memory + (cone_bytes(s.rows, s.coupled) - box_bytes(s.rows)));
    return s;
}

int cone_setup(void *memory, int rows, int coupled, const real *A, const real *b, const int64_t *index)
{
    const int64_t bytes = cone_bytes(rows, coupled);
    BoxHead *const dual = (BoxHead *)(void *)((char *)memory + (bytes - box_bytes(rows)));
    ConeHead *const head = memory;
    Cone s;
    memset(memory, 0, (size_t)bytes);
    head->kind = CONE_KIND;
    head->d = coupled;
    head->bytes = bytes;
    head->rows = rows;
    dual->d = rows;
    s = cone_at(memory);
    memcpy(s.A, A, (size_t)rows * (size_t)coupled * sizeof(real));
    memcpy(s.b, b, (size_t)rows * sizeof(real));
    for (int k = 0; k < coupled; ++k) {
        s.index[k] = (int32_t)index[k];
    }
    for (int i = 0; i < rows; ++i) { /* multipliers from zero up; the box clears its own memory, so they wait in ours */
        s.slack[i] = REAL_INFINITY;
        s.zero[i] = 0;
    }
    box_setup(dual, rows, s.zero, s.slack);
    for (int i = 0; i < rows; ++i) {
        for (int j = 0; j < rows; ++j) {
            real total = 0;
            for (int k = 0; k < coupled; ++k) {
                total += s.A[i * coupled + k] * s.A[j * coupled + k];
            }
            s.dual.V[i * rows + j] = total; /* room that no part of the solver reads before it writes */
        }
    }
    return box_take_hessian(&s.dual, s.dual.V);
}

int cone_project(Cone *s, real *x)
{
    int status;
    for (int i = 0; i < s->rows; ++i) {
        real slack = s->b[i];
        for (int k = 0; k < s->coupled; ++k) {
            slack -= s->A[i * s->coupled + k] * x[s->index[k]];
        }
        s->slack[i] = slack;
    }
    status = box_take_linear(&s->dual, s->slack);
    status = status == OK ? box_solve(&s->dual, 1) : status;
    for (int k = 0; k < s->coupled; ++k) {
        real pull = 0;
        for (int i = 0; i < s->rows; ++i) {
            pull += s->A[i * s->coupled + k] * s->dual.answer[i];
        }
        x[s->index[k]] -= pull;
    }
    return status;
}
