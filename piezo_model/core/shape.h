/* The numbers of operators of a model, and the sizes of vectors that follow from them. */
#ifndef CORE_SHAPE_H
#define CORE_SHAPE_H

#include "arena.h"

typedef struct {
    int32_t n;      /* thresholds above zero of play and creep */
    int32_t zones;  /* dead zones of S^-1 */
    int16_t rates;  /* creep rates */
    int16_t ring;   /* samples that the rings of a prefilter hold; 0 without dynamics */
    int16_t offset; /* 1 with a free constant, else 0 */
    int16_t modes;  /* of the dynamics */
} Shape;

/* The head of every state of this package. */
typedef struct {
    StateHead state;
    Shape shape;
} ShapedHead;

/* The shape in a head; a constant in an exported folder, -DCORE_SHAPE={.n=5,.zones=7,.rates=3}. */
#ifdef CORE_SHAPE
static const Shape exported_shape = CORE_SHAPE;
#define SHAPE(head) exported_shape
#else
#define SHAPE(head) (head)->shape
#endif

/* Memory of a state for a struct. */
CORE_INLINE void *arena_part(Arena *arena, size_t bytes)
{
    void *const first = arena->at;
    arena->at += arena_bytes((int64_t)bytes);
    return first;
}

/* Play and creep have whole vectors of eight: n + 1 thresholds, then padding with threshold and weight zero. Creep
 * states are ordered rate by rate. */
CORE_INLINE int lanes(Shape s) { return padded(s.n + 1); }
CORE_INLINE int creep_lanes(Shape s) { return s.rates * lanes(s); }
CORE_INLINE int rate_lanes(Shape s) { return padded(s.rates); }
CORE_INLINE int zone_lanes(Shape s) { return padded(s.zones); }
CORE_INLINE int creep_weights(Shape s) { return s.rates > 0 ? s.n + 1 : 0; }
/* d: w_H1 ... w_Hn, w'_S, w_K, [offset]. */
CORE_INLINE int unknowns(Shape s) { return s.n + s.zones + creep_weights(s) + s.offset; }
/* Initialise a state of this package with zeros. */
CORE_INLINE void new_shaped_state(void *memory, int32_t kind, Shape s, int64_t bytes)
{
    new_state(memory, kind, unknowns(s), bytes);
    ((ShapedHead *)memory)->shape = s;
}

/* The weights of a model: w_H0 ... w_Hn, w'_S, w_K, offset. */
CORE_INLINE int weight_count(Shape s) { return s.n + 2 + s.zones + creep_weights(s); }

#endif
