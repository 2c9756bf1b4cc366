/* What the exchanges on the inverse leave: the program in the variables z as one of block_pivoting.h, with a factor of
 * P_FF for each system.
 *
 * It stands where the exchanges keep their columns, so it is made anew after them.
 */
#ifndef CORE_BOX_FALLBACK_H
#define CORE_BOX_FALLBACK_H

#include "block_pivoting.h"
#include "box.h"

#define BOX_PROXIMAL ((real)1e-11) /* of the diagonal of P, the proximal term where P is singular */

typedef struct {
    BoxHead *head;
    Pivoting program;
    real *multiplier, *centre; /* d: of box_dual.c, and c */
} Fallback;

CORE_INLINE int64_t fallback_bytes(int d) { return pivoting_bytes(d) + 2 * (int64_t)sizeof(real) * padded(d); }
CORE_INLINE Fallback fallback_at(const Box *s)
{
    Arena arena = {s->fallback};
    Fallback f = {.head = s->head};
    f.multiplier = reals(&arena, 1, padded(s->d));
    f.centre = reals(&arena, 1, padded(s->d));
    f.program = pivoting_at(&arena, s->d);
    return f;
}

/* Add the proximal term; OK, or INDEFINITE where P has a pivot that is not positive even so. */
CORE_API int box_regularise(const Fallback *f);
/* One linear system with the sides as they are; 0 where P_FF is not positive definite to rounding. */
CORE_API int box_newton(const Fallback *f);
CORE_API int box_dual_active_set(const Fallback *f);

#endif
