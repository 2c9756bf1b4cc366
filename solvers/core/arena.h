/* A block of memory divided into vectors and matrices: a state, which consists of its bytes and has no pointers.
 *
 * A struct of the core names the parts of such a block. The functions that end in _at make it on the stack by a few
 * additions, by none if d is a constant.
 */
#ifndef CORE_ARENA_H
#define CORE_ARENA_H

#include "vec8.h"

enum { HEAD_BYTES = 128 }; /* size of the head of a state; vectors begin on cache lines if the state does */

/* The beginning of every head: kind of the state, number of variables and size in bytes. */
typedef struct {
    int32_t kind, d;
    int64_t bytes;
} StateHead;

/* Make a block a state of this kind, all zeros. */
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

/* A vector or matrix of a state: the pointer to set, and the number of entries. */
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

/* Bytes rounded up to whole cache lines. */
CORE_INLINE int64_t arena_bytes(int64_t bytes) { return (bytes + 63) / 64 * 64; }

/* Integers, padded so that the next part begins on a cache line. */
CORE_INLINE int32_t *integers(Arena *arena, int count)
{
    int32_t *const first = (int32_t *)(void *)arena->at;
    arena->at += (size_t)padded(count) * 8;
    return first;
}

#endif
