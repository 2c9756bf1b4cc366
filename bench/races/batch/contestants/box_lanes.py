"""Our block pivoting of eight programs in the lanes of one register, as a bank of compensators calls it; here from a
cold start."""

from bench.races.batch.contestants import box_batch


class Lanes(box_batch.Batch):
    """The batch solver on lanes."""

    algorithm = "block pivoting in lanes"
    simd_batched = True
