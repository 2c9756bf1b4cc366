"""Batches of box programs of one size, each solved to its exact optimum, on several threads.

    minimise ½ xᵀP_b x + q_bᵀx   subject to   lb_b ≤ x ≤ ub_b,   b = 1 … B

Each answer equals that of a cold ``box_active_set`` to the last bit and depends neither on the other programs nor on
the number of threads; a program without an answer affects its own row only. The programs are solved one after the other
in compiled code, without the interpreter's lock.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.arrays import Matrix, shaped
from solvers.core import OK, REASONS, bindings, block, padded

MOST_VARIABLES = 1000
SHARES = 16
"""Chunks of a batch per thread, so that the threads end at about the same time."""
LEAST_SHARE = 64
"""Smallest chunk in programs; waking a thread for fewer does not pay."""


class BoxBatch:
    """Exact solver of batches of box programs.

    Parameters
    ----------
    d : int
        Variables of each program, 1 to 1000.
    threads : int, optional
        Largest number of threads; by default one for each core that this process may run on.

    Attributes
    ----------
    statuses : array, shape (B,), int32
        Status of each program of the last batch, see ``solvers.core``.

    Raises
    ------
    ValueError
        d or threads are out of range.

    Examples
    --------
    >>> import numpy as np
    >>> P, q = np.tile(np.eye(2), (3, 1, 1)), np.array([[-1.0, 1.0], [-3.0, 0.5], [np.nan, 0.0]])
    >>> batch = BoxBatch(2)
    >>> x, found = batch.solve(P, q, np.zeros((3, 2)), np.full((3, 2), 2.0))
    >>> x.tolist(), found.tolist()
    ([[1.0, 0.0], [2.0, 0.0], [nan, nan]], [True, True, False])
    >>> batch.reason(2)
    'P, q and a starting point must be finite and bounds must not be NaN'
    """

    def __init__(self, d: int, threads: int | None = None) -> None:
        if not 1 <= d <= MOST_VARIABLES:
            raise ValueError(f"a program has 1 to {MOST_VARIABLES} variables, and not {d}")
        self.d = d
        self.threads = usable_cores() if threads is None else threads
        if self.threads < 1:
            raise ValueError(f"there must be at least one thread, and not {threads}")
        self.statuses: NDArray[np.int32] = np.zeros(0, np.int32)
        self._workspaces: SimpleQueue[NDArray[np.uint8]] = SimpleQueue()
        for _ in range(self.threads):
            self._workspaces.put(block(bindings.box_bytes(d)))
        # threads start with their first work
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> tuple[Matrix, NDArray[np.bool_]]:
        """Solve a batch.

        Parameters
        ----------
        P : array, shape (B, d, d), or (d, d) for one that all programs share
            Symmetric and positive semidefinite; arrays other than float64 in C order are copied.
        q, lb, ub : array, shape (B, d)
            Bounds may be infinite on their open side.

        Returns
        -------
        x : array, shape (B, d)
            The minimisers; NaN for programs without one.
        found : array, shape (B,), bool

        Raises
        ------
        ValueError
            An array has a wrong shape or is not of real numbers.
        """
        count, *_ = np.shape(q) or (0,)
        linear, *bounds = (shaped(name, values, (count, self.d)) for name, values in (("q", q), ("lb", lb), ("ub", ub)))
        shape = (self.d, self.d) if np.ndim(P) == 2 else (count, self.d, self.d)
        matrices = shaped("P", P, shape).reshape(-1, self.d * self.d)
        x, self.statuses = np.empty((count, self.d)), np.empty(count, np.int32)

        def solve_chunk(first: int, last: int) -> None:
            workspace = self._workspaces.get()
            try:
                bindings.box_batch(linear, matrices, *bounds, x, self.statuses, workspace, first, last)
            finally:
                self._workspaces.put(workspace)

        size = max(LEAST_SHARE, padded(-(-count // (SHARES * self.threads))))
        if self._pool is None or count <= size:
            solve_chunk(0, count)
        else:
            starts = range(0, count, size)
            list(self._pool.map(solve_chunk, starts, (min(start + size, count) for start in starts)))
        found: NDArray[np.bool_] = self.statuses == OK
        if np.count_nonzero(found) < count:
            x[~found] = np.nan
        return x, found

    def __reduce__(self) -> tuple[Any, ...]:
        # a copy has threads and workspaces of its own
        return BoxBatch, (self.d, self.threads), {"statuses": self.statuses.copy()}

    def reason(self, b: int) -> str:
        """Why program b of the last batch has no answer, in a sentence; "" if it has one."""
        return "" if self.statuses[b] == OK else REASONS[int(self.statuses[b])]


def usable_cores() -> int:
    """Number of cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
