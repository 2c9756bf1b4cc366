"""Our block pivoting of eight programs in the lanes of one register, as a bank of compensators calls it; here from a cold start."""

from __future__ import annotations

from bench.races.batch.contestants.kernel import box_batch
from solvers import BoxBatch


class Lanes(BoxBatch):
    """Eight at a time; what the lanes leave unsolved goes to the exact solver."""

    _lanes = 1


class Ours(box_batch.Ours):
    """The batch solver on lanes."""

    algorithm = "block pivoting in lanes"
    batches = Lanes
