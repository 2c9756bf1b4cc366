/* One block of memory divided into vectors and matrices, the same way every time: a state is its bytes and has no
 * pointers.
 *
 * A struct of the core is a set of names for the parts of such a block. It is made on the stack by the functions that
 * end in _at, which do a few additions, none where d is a constant.
 */
#ifndef CORE_ROOM_H
#define CORE_ROOM_H

#include "vec8.h"

enum { HEAD_BYTES = 128 }; /* what a state begins with; vectors are on cache lines where the state is */

typedef struct {
    char *at;
} Room;

CORE_INLINE Room after_head(void *memory)
{
    const Room room = {(char *)memory + HEAD_BYTES};
    return room;
}

CORE_INLINE real *reals(Room *room, int rows, int columns)
{
    real *const first = (real *)(void *)room->at;
    room->at += (size_t)rows * (size_t)columns * sizeof(real);
    return first;
}

/* Vectors of one length, one after the other. */
CORE_INLINE void name_vectors(Room *room, int length, real **const *names, int count)
{
    for (int i = 0; i < count; ++i) {
        *names[i] = reals(room, 1, length);
    }
}

/* What so many bytes take where the next part begins on a cache line. */
CORE_INLINE int64_t room_bytes(int64_t bytes) { return (bytes + 63) / 64 * 64; }

/* Whole numbers, as many bytes as so many reals, so that what follows stays on its cache line. */
CORE_INLINE int32_t *integers(Room *room, int count)
{
    int32_t *const first = (int32_t *)(void *)room->at;
    room->at += (size_t)padded(count) * 8;
    return first;
}

#endif
