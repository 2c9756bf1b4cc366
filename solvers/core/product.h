/* out = c + M x, the product that dominates the time of every method here. */
#ifndef CORE_PRODUCT_H
#define CORE_PRODUCT_H

#include "vec8.h"

/* Blocks of eight rows that stay in registers during the loop over the columns. */
enum { PRODUCT_BLOCKS = PARTS == 1 ? 3 : PARTS == 2 ? 2 : 1 };

/* Some blocks of rows of the product; even and odd columns have separate sums, which shortens the chain of additions.
 */
CORE_INLINE void affine_blocks(const real *columns, int ld, int d, const real *x, const real *c, real *out, int blocks)
{
    vec8 even[PRODUCT_BLOCKS], odd[PRODUCT_BLOCKS];
    for (int i = 0; i < blocks; ++i) {
        even[i] = load(c + LANES * i);
        odd[i] = zeros();
    }
    for (int j = 0; j + 1 < d; j += 2) {
        const real *const m = columns + (size_t)j * (size_t)ld, *const n = m + ld;
        const vec8 t = splat(x[j]), u = splat(x[j + 1]);
        for (int i = 0; i < blocks; ++i) {
            even[i] = plus_product(even[i], load(m + LANES * i), t);
            odd[i] = plus_product(odd[i], load(n + LANES * i), u);
        }
    }
    for (int i = 0; i < blocks; ++i) {
        if (d % 2 != 0) {
            even[i] = plus_product(even[i], load(columns + (size_t)(d - 1) * (size_t)ld + LANES * i), splat(x[d - 1]));
        }
        store(out + LANES * i, add(even[i], odd[i]));
    }
}

/* out (ld) = c (ld) + M x, with M by columns: column j begins at columns + j ld, and ld is a multiple of eight. */
CORE_INLINE void affine(const real *columns, int ld, int d, const real *x, const real *c, real *out)
{
    int b = 0;
    for (; b + LANES * PRODUCT_BLOCKS <= ld; b += LANES * PRODUCT_BLOCKS) {
        affine_blocks(columns + b, ld, d, x, c + b, out + b, PRODUCT_BLOCKS);
    }
    for (; PRODUCT_BLOCKS > 1 && b < ld; b += LANES) {
        affine_blocks(columns + b, ld, d, x, c + b, out + b, 1);
    }
}

#endif
