/* One block of memory divided into vectors and matrices, the same way every time: a state is its bytes and has no
 * pointers.
 *
 * A struct of the core is a set of names for the parts of such a block. It is made on the stack by the functions that
 * end in _at, which do a few additions, none where d is a constant.
 */
#ifndef CORE_ARENA_H
#define CORE_ARENA_H

#include "vec8.h"

enum { HEAD_BYTES = 128 }; /* what a state begins with; vectors are on cache lines where the state is */

/* Every state begins so: what it is, its number of variables and its size in bytes. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
} StateHead;

/* Make a block such a state, of zeros. */
CORE_INLINE void new_state(void *memory, int32_t kind, int d, int64_t bytes)
{
    const StateHead head = {kind, d, bytes};
    memset(memory, 0, (size_t)bytes);
    memcpy(memory, &head, sizeof head);
}

typedef struct {
    char *at;
} Arena;

CORE_INLINE Arena after_head(void *memory) { return (Arena){(char *)memory + HEAD_BYTES}; }

CORE_INLINE real *reals(Arena *arena, int rows, int columns)
{
    real *const first = (real *)(void *)arena->at;
    arena->at += (size_t)rows * (size_t)columns * sizeof(real);
    return first;
}

/* A vector or matrix of a state: what is to point at it, and how many numbers it has. */
typedef struct {
    real **first;
    int count;
} Extent;

/* Lay out an array of these, one after the other. */
#define LAY_OUT(arena, extents) lay_out(arena, extents, sizeof(extents) / sizeof *(extents))
CORE_INLINE void lay_out(Arena *arena, const Extent *extents, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        *extents[i].first = reals(arena, 1, extents[i].count);
    }
}

/* What so many bytes take where the next part begins on a cache line. */
CORE_INLINE int64_t arena_bytes(int64_t bytes) { return (bytes + 63) / 64 * 64; }

/* Whole numbers, as many bytes as so many reals, so that what follows stays on its cache line. */
CORE_INLINE int32_t *integers(Arena *arena, int count)
{
    int32_t *const first = (int32_t *)(void *)arena->at;
    arena->at += (size_t)padded(count) * 8;
    return first;
}

#endif
