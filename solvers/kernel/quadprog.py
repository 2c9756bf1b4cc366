"""quadprog by its C function: the algorithm of the direct lane, see :mod:`solvers.direct.quadprog`.

Timed inside compiled code: ``update`` passes pointers to the new P and q; ``solve`` copies both, since the library
overwrites them, and calls its function, which writes its answer to our array.
"""

import numpy as np
import quadprog

from solvers.adapter import Cones, Program, Report
from solvers.direct import quadprog as direct
from solvers.kernel._library import CompiledLibrary, open_library

QUADPROG = open_library("quadprog", "0.1.14", quadprog.__file__, ("qpgen2_",))
MESSAGES = ("solved", "constraints are inconsistent, no solution", "matrix G is not positive definite")


class Quadprog(CompiledLibrary, direct.Quadprog):
    """The library's ``qpgen2_``."""

    def build(self, p: Program, rows: Cones) -> None:
        d, least = p.d, min(p.d, rows.r.size)
        self._lagrangian, self._counts = np.zeros(rows.r.size), np.zeros(2, dtype=np.intc)
        self.pack_state(
            np.empty((d, d)),
            np.empty(d),
            self._lagrangian,
            -rows.R,
            -rows.r,
            np.empty(2 * (d + rows.r.size) + least * (least + 5) // 2),
            np.empty(max(d, rows.r.size), dtype=np.intc),
            self._counts,
            rows.r.size,
            rows.equal,
            QUADPROG.qpgen2_,
            0,
        )

    def report(self) -> Report:
        return Report(self.state[-1] == 0, self._lagrangian, MESSAGES[self.state[-1]], int(self._counts[0]))
