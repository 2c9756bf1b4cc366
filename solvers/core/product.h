/* out = c + M x, the product on which every method here spends its time. */
#ifndef CORE_PRODUCT_H
#define CORE_PRODUCT_H

#include "vec8.h"

/* Blocks of eight rows that stay in registers while the columns pass by. */
enum { PRODUCT_BLOCKS = PARTS == 1 ? 3 : PARTS == 2 ? 2 : 1 };

/* Rows b ... b + 8 blocks - 1 of the product: even and odd columns are summed apart, so that no sum waits for the one
 * before. */
CORE_INLINE void affine_blocks(const real *columns, int ld, int d, const real *x, const real *c, real *out, int blocks)
{
    vec8 even0 = load(c), even1 = blocks > 1 ? load(c + 8) : zeros(), even2 = blocks > 2 ? load(c + 16) : zeros();
    vec8 odd0 = zeros(), odd1 = odd0, odd2 = odd0;
    int j = 0;
    for (; j + 1 < d; j += 2) {
        const real *const m = columns + (size_t)j * (size_t)ld, *const n = m + ld;
        const vec8 t = splat(x[j]), u = splat(x[j + 1]);
        even0 = plus_product(even0, load(m), t);
        odd0 = plus_product(odd0, load(n), u);
        if (blocks > 1) {
            even1 = plus_product(even1, load(m + 8), t);
            odd1 = plus_product(odd1, load(n + 8), u);
        }
        if (blocks > 2) {
            even2 = plus_product(even2, load(m + 16), t);
            odd2 = plus_product(odd2, load(n + 16), u);
        }
    }
    if (j < d) {
        const real *const m = columns + (size_t)j * (size_t)ld;
        const vec8 t = splat(x[j]);
        even0 = plus_product(even0, load(m), t);
        even1 = blocks > 1 ? plus_product(even1, load(m + 8), t) : even1;
        even2 = blocks > 2 ? plus_product(even2, load(m + 16), t) : even2;
    }
    store(out, add(even0, odd0));
    if (blocks > 1) {
        store(out + 8, add(even1, odd1));
    }
    if (blocks > 2) {
        store(out + 16, add(even2, odd2));
    }
}

/* out (ld) = c (ld) + M x, with M by columns: column j begins at columns + j ld, and ld is a multiple of eight. */
CORE_INLINE void affine(const real *columns, int ld, int d, const real *x, const real *c, real *out)
{
    int b = 0;
    for (; PRODUCT_BLOCKS > 2 && b + 24 <= ld; b += 24) {
        affine_blocks(columns + b, ld, d, x, c + b, out + b, 3);
    }
    for (; PRODUCT_BLOCKS > 1 && b + 16 <= ld; b += 16) {
        affine_blocks(columns + b, ld, d, x, c + b, out + b, 2);
    }
    for (; b < ld; b += 8) {
        affine_blocks(columns + b, ld, d, x, c + b, out + b, 1);
    }
}

#endif
