"""Our exact solver, which solves one program after the other in compiled code: :class:`solvers.BoxBatch`."""

from bench.races.batch.contestant import Contestant
from solvers import BoxBatch
from solvers.arrays import Matrix
from solvers.built_in import BuiltIn


class Batch(BuiltIn, Contestant):
    """The public batch solver."""

    algorithm = "dual active set"

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._batch = BoxBatch(d, threads)

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:  # noqa: D102
        return self._batch.solve(P, q, lb, ub)[0]
