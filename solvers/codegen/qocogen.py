"""QOCOGEN: an interior point method whose factorisation is written out for the pattern of one problem.

    minimise ½ xᵀP x + qᵀx   subject to   G x ≤ h;   rows of G: −x_i for lower and x_i for upper bounds

Source: G. M. Chari, B. Açıkmeşe, "QOCO: a quadratic objective conic optimizer with custom solver generation" (2025).

Timed: ``update`` copies the upper triangle of P and q; ``solve`` factorises in each of its steps.
"""

import contextlib
import io
from pathlib import Path

import numpy as np
import qocogen
from scipy.sparse import csc_matrix

from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape, generator


class Qocogen(Embedded):
    """``qocogen.generate_solver``."""

    library = generator("interior point", "BSD-3-Clause", "qocogen")

    def generate(self, shape: Shape, folder: Path) -> Sources:
        # Only the sparsity pattern matters: P, q and h are replaced.
        d, rows = shape.d, len(shape.below) + len(shape.above)
        G = csc_matrix(np.vstack([-np.eye(d)[list(shape.below)], np.eye(d)[list(shape.above)]]))
        with contextlib.redirect_stdout(io.StringIO()):
            qocogen.generate_solver(
                d,
                rows,
                0,
                csc_matrix(np.triu(np.eye(d) + 1e-3)),
                np.ones(d),
                None,
                None,
                G,
                np.ones(rows),
                rows,
                0,
                None,
                output_dir=str(folder),
                name="qoco",
            )
        written = folder / "qoco"
        return Sources(
            tuple(path for path in sorted(written.glob("*.c")) if path.name != "runtest.c"), (f"-I{written}",)
        )
