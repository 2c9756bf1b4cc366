"""Moreau's active set solver: DAQP in C++ behind a Rust module, with its problem in sparse form.

    minimise ½ xᵀP x + qᵀx   subject to   A x + s = b,  s ∈ {0}ᵖ × ℝ₊ᵐ

Source: D. Arnström, A. Bemporad, D. Axehill, "A dual active-set solver for embedded quadratic programming using
recursive LDLᵀ updates", IEEE Transactions on Automatic Control 67 (2022), pages 4362 to 4369; the package moreau-cpu.

Timed: ``update`` passes the values of P, all d² of them, to the library; ``solve`` is one call, with q and the right
hand side, and makes arrays of its lists. It transforms the problem at each solve. A warm start would need multipliers
and slacks, so there is none. The library's interior point solver descends from Clarabel, which is raced itself.
"""

import numpy as np
from moreau_cpu import _cpu_solver as moreau

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Unsupported, Vector
from solvers.backend import Backend, relative

SOLVED = 1
"""The library's ``SolverStatus.Solved``."""


class Moreau(LibrarySolver):
    """The library's ``ActiveSetSolver``."""

    library = Backend(
        "dual active set",
        "Apache-2.0",
        "moreau-cpu",
        {"primal_tol": relative},
        (9, 12),
        rung_settings={"iter_limit": 100_000},
    )
    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        d, m = p.d, rows.r.size
        if not m:  # the library would end the process
            raise Unsupported("moreau needs at least one row or bound, and the problem has none")
        settings = moreau.ActiveSetSettings(**self.settings)
        dense = {
            f"{name}_{part}": values for name, n in (("P", d), ("A", m)) for part, values in _pattern(n, d).items()
        }
        self._solver = moreau.ActiveSetSolver(
            n=d,
            m=m,
            batch_size=1,
            **dense,
            nnz_P=d * d,
            nnz_A=m * d,
            num_zero_cones=rows.equal,
            num_nonneg_cones=rows.unequal,
            settings=settings,
            enable_grad=False,
            verbose=False,
        )
        self.pass_data(p.P, p.q)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        if P is not None:
            self._solver.setup(P.reshape(-1), self.rows.R.reshape(-1), True)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = r = self._solver.solve(self.program.q, self.rows.r)
        return np.array(r["x"]) if r["status"][0] == SOLVED else None

    def report(self) -> Report:
        r = self._result
        status = "solved" if r["status"][0] == SOLVED else f"status {r['status'][0]}"
        return Report(np.array(r["x"]), np.array(r["z"]), status, r["iterations"][0], 1e6 * r["solve_time"])


def _pattern(rows: int, columns: int) -> dict[str, list[int]]:
    """The pattern of a dense matrix in compressed rows."""
    return {"row_offsets": list(range(0, (rows + 1) * columns, columns)), "col_indices": list(range(columns)) * rows}
