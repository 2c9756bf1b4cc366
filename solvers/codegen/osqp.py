"""OSQP's own embedded C (``codegen``): ADMM with P and q that may change.

Source: G. Banjac, B. Stellato, N. Moehle, P. Goulart, A. Bemporad, S. Boyd, "Embedded code generation using the OSQP
solver", IEEE Conference on Decision and Control (2017).

Timed: ``update`` copies the upper triangle of P and q, scales and factorises; ``solve`` iterates, cold from zero. The
adapted penalty ρ is kept for the next solve, as the library intends. The interval of adaptation is counted in steps.
"""

from pathlib import Path

import numpy as np
import osqp
from scipy.sparse import csc_matrix

from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape, generator
from solvers.rows import Triangle


class Osqp(Embedded):
    """The files of ``osqp.OSQP.codegen`` with parameters "matrices"."""

    library = generator("ADMM", "Apache-2.0", "osqp")
    warm_startable = True

    def generate(self, shape: Shape, folder: Path) -> Sources:
        # Only the sparsity pattern matters, the numbers are replaced; the rows are those of bounded variables.
        d, rows = shape.d, list(shape.bounded)
        P = Triangle(d).matrix(np.eye(d) + 1e-3)
        solver = osqp.OSQP()
        solver.setup(
            P,
            np.ones(d),
            csc_matrix(np.eye(d)[rows]),
            np.zeros(len(rows)),
            np.ones(len(rows)),
            verbose=False,
            polishing=False,
            adaptive_rho=1,
            adaptive_rho_interval=50,
        )
        solver.codegen(str(folder / "osqp"), parameters="matrices")
        written = folder / "osqp"
        return Sources(
            (*sorted((written / "src").glob("*.c")), written / "workspace.c"),
            tuple(f"-I{written / part}" for part in (".", "inc/public", "inc/private")),
        )
