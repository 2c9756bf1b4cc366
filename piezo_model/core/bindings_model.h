/* Macros that the bindings of this package share. */
#ifndef CORE_BINDINGS_MODEL_H
#define CORE_BINDINGS_MODEL_H

#include "bindings.h"
#include "shape.h"

/* A shape as four arguments, the first of which has number i. */
#define SHAPED "n#0:10000, zones#1:10000, rates#0:10000, offset#0:1"
#define SHAPE_AT(i) ((Shape){.n = INT(i), .zones = INT(i + 1), .rates = SHORT(i + 2), .offset = SHORT(i + 3)})
/* The same with those of the dynamics. */
#define FILTERED SHAPED ", modes#0:2, ring#0:32767"
#define FILTERED_AT(i)                                                                                                 \
    ((Shape){.n = INT(i),                                                                                              \
             .zones = INT(i + 1),                                                                                      \
             .rates = SHORT(i + 2),                                                                                    \
             .offset = SHORT(i + 3),                                                                                   \
             .modes = SHORT(i + 4),                                                                                    \
             .ring = SHORT(i + 5)})
#define SHORT(i) ((int16_t)a.values[i].whole)
/* Whether calls for n samples take long. */
#define SAMPLES_LAST (LENGTH(n) > 100)

/* Whether numbers of a file are at most 1e100, beyond which those computed from them may not be finite. */
static inline int all_bounded(const real *v, int64_t count)
{
    real sum = 0;
    for (int64_t i = 0; i < count; ++i) {
        const real scaled = v[i] * (real)1e208;
        sum += scaled - scaled; /* 0, or NaN */
    }
    return sum == 0;
}

/* Fields of regressors `p` of a shape that Python fills in. */
#define REGRESSOR_PARTS(p, s)                                                                                          \
    {"r", (p)->operators.r, lanes(s)}, {"a", (p)->operators.a, (s).rates}, {"low", (p)->low, zone_lanes(s)},           \
        {"high", (p)->high, zone_lanes(s)}, {"outer_low", (p)->outer_low, zone_lanes(s)},                              \
    {                                                                                                                  \
        "outer_high", (p)->outer_high, zone_lanes(s)                                                                   \
    }

#endif
