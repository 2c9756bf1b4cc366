/* Memory shared by the step (an interrupt) and the learner (a background task): blocks of samples in one direction,
 * weights in the other.
 *
 * The ring of blocks has one producer and one consumer. The step fills the block `published`; a full block is published
 * if the ring is not full, else dropped. Each block begins with the operator states, so that a dropped one loses its
 * own samples only. There is one offer of weights: the learner writes it while `offered` equals `answered`, and the
 * step answers it by taking it or not. The counters are 32 bits wide and have one writer each, which releases its data
 * before them. Both sides run on one core or on coherent ones.
 *
 * Weights from an interval that ends at sample k are taken at sample k + delay, never sooner; late ones are taken at
 * the next beginning of a block. The drive is thus independent of the learner's run time while it is in time. `epoch`
 * is raised while the learner rests, and invalidates blocks and offers of an older one.
 *
 * Numbers have the step's precision, `shared`; the learner's sums are doubles.
 */
#ifndef CORE_MAILBOX_H
#define CORE_MAILBOX_H

#include "compensator.h"

#ifdef CORE_FLOAT_SIGNALS
typedef float shared;
#else
typedef real shared;
#endif

/* CORE_ACQUIRE(p) and CORE_RELEASE(p, value) for 32-bit counters; other compilers need definitions of the user's. */
#ifndef CORE_ACQUIRE
#if defined(__GNUC__)
#define CORE_ACQUIRE(p) __atomic_load_n(p, __ATOMIC_ACQUIRE)
#define CORE_RELEASE(p, value) __atomic_store_n(p, value, __ATOMIC_RELEASE)
#else
#error "define CORE_ACQUIRE(p) and CORE_RELEASE(p, value), an atomic load and store of uint32_t with these orders"
#endif
#endif

typedef struct {
    int32_t block, blocks; /* samples of a block, blocks of the ring */
    int64_t delay;
    int64_t samples;       /* observed so far, plus the offset at which a tile began */
    int32_t filled, to_go; /* samples in the current block, and samples missing in it */
    int32_t place,
        skipped; /* position of the current block in the ring; samples missing at the begin of the first block */
    uint32_t published, consumed, offered, answered, epoch;
    uint32_t dropped, late; /* blocks, and offers */
} MailboxHead;

typedef struct {
    int64_t first; /* number of its first sample */
    int32_t count;
    uint32_t epoch, answered; /* the latter when it began */
} BlockHead;

/* Operator states at its beginning; drive and output of each sample in normalised units, with NaN for a bad output; and
 * the number of sensor faults up to its end. */
typedef struct {
    BlockHead *head;
    shared *play, *creep, *x, *y, *faults;
} Block;

/* Weights and their inverse for the actuators where `which` is 1; the number of faults that the learner knew, 1 where
 * it falls back after a fault, and the standard deviation of the sensor's
 * noise. */
typedef struct {
    int64_t *due;
    uint32_t *epoch;
    shared *inverse, *which, *faults, *fallback, *noise;
} Offer;

typedef struct {
    MailboxHead *head;
    Shape shape;
    shared *guard, *faults; /* the sensor guard, and the faults so far */
    shared *noise_gains;    /* with dynamics: see noise.c */
    Offer offer;
    char *ring;
} Mailbox;

#define MOST_COUNTED ((real)1e6) /* largest fault count, then it restarts at 0: floats count up to 2^24 */

enum { GUARD_NUMS = 16 };
CORE_INLINE int64_t shared_bytes(int count) { return arena_bytes((int64_t)sizeof(shared) * WIDTH * count); }
CORE_INLINE int state_nums(Shape s) { return (play_vectors(s) + creep_vectors(s)) * (LANES / WIDTH); }
CORE_INLINE int64_t block_bytes(Shape s, int block) { return 64 + shared_bytes(state_nums(s) + 2 * block + 1); }
/* The size of a mailbox with numbers of so many bytes. */
CORE_INLINE int64_t mailbox_size(Shape s, int block, int blocks, int64_t number_bytes)
{
    return arena_bytes(sizeof(MailboxHead)) + arena_bytes(number_bytes * GUARD_NUMS) + 64
           + arena_bytes(number_bytes * (inverse_nums(s) + 4))
           + blocks * (64 + arena_bytes(number_bytes * (state_nums(s) + 2 * block + 1)));
}
CORE_INLINE int64_t mailbox_bytes(Shape s, int block, int blocks)
{
    return mailbox_size(s, block, blocks, (int64_t)sizeof(shared) * WIDTH);
}

CORE_INLINE Mailbox mailbox_at(char *memory, Shape s)
{
    char *const guarded = memory + arena_bytes(sizeof(MailboxHead)), *const offered =
                                                                         guarded + shared_bytes(GUARD_NUMS);
    shared *const guard = (shared *)(void *)guarded, *const inverse = (shared *)(void *)(offered + 64);
    shared *const which = inverse + WIDTH * inverse_nums(s);
    return (Mailbox){
        .head = (MailboxHead *)(void *)memory,
        .shape = s,
        .guard = guard,
        .faults = guard + WIDTH * (GUARD_NUMS - 1),
        .noise_gains = guard + WIDTH * (GUARD_NUMS - 3),
        .offer = {(int64_t *)(void *)offered, (uint32_t *)(void *)(offered + 8), inverse, which, which + WIDTH,
                  which + 2 * WIDTH, which + 3 * WIDTH},
        .ring = offered + 64 + shared_bytes(inverse_nums(s) + 4),
    };
}

CORE_INLINE Block block_in(const Mailbox *m, int32_t place)
{
    char *const at = m->ring + block_bytes(m->shape, m->head->block) * place;
    shared *const play = (shared *)(void *)(at + 64), *const x = play + WIDTH * state_nums(m->shape);
    shared *const creep = play + play_vectors(m->shape) * LANES, *const y = x + WIDTH * m->head->block;
    return (Block){(BlockHead *)(void *)at, play, creep, x, y, y + WIDTH * m->head->block};
}

CORE_INLINE Block block_at(const Mailbox *m, uint32_t number)
{
    return block_in(m, (int32_t)(number % (uint32_t)m->head->blocks));
}

CORE_INLINE num from_shared(const shared *p, int i)
{
#ifdef CORE_TILE
    return load(p + i * LANES);
#else
    return p[i];
#endif
}
CORE_INLINE void to_shared(shared *p, int i, num a)
{
#ifdef CORE_TILE
    store(p + i * LANES, a);
#else
    p[i] = (shared)a;
#endif
}

#endif
