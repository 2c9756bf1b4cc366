"""Our exact solver for problems with bounds only: the dual active set method on the inverse.

    minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub

With F the free variables and A those at a bound, x is the minimiser if x_F = −P_FF⁻¹ (q_F + P_FA x_A) is inside its
bounds and g_A = q_A + P_A x has the sign that holds each bound. Sweeping P on j (Beaton; Goodnight) moves j between A
and F, and swept on all, which costs d³ multiplications without a square root and proves P positive definite, it is
−P⁻¹: the start, every variable free. From there the variable whose bound is broken and gains most, violation²/|M_jj|,
goes to its bound, by one column M_j of the tableau, and a bound whose multiplier vanishes on the way is let go
(Goldfarb & Idnani), until nothing is broken: the dual cost rises with each, so no active set returns. One step of
refinement with the true residual q + P x then makes rounding that of the data.

For a singular P, a small proximal term about the previous iterate is added, which vanishes in the limit
(``solvers/core/box_proximal.c``).

``found`` means that the optimality conditions hold to rounding, by the bounds at the top of
``solvers/core/box_dual.c``, and that the cost is above its least by no more than 1e-10 of itself, as estimated from the
curvature of P. Powers of two times P, q or the bounds change no bit of the answer. Where curvatures below rounding or
bounds of 1e20 keep the solver from that, it refuses the program.

``update`` is one call of a compiled function that checks, scales and inverts P, and ``solve`` is another, on work
arrays allocated by ``setup``. Of the 1.7 µs for both at d = 18, called from Python on one machine, the two calls and
the clock took 0.7, the checked copy 0.1, the sweeps 0.4, the first point and six exchanges 0.3, refinement and answer
0.2.

Sources: A. E. Beaton, The use of special matrix operators in statistical calculus, ETS RB-64-51, 1964; J. H. Goodnight,
American Statistician 33 (1979) 149; D. Goldfarb, A. Idnani, Math. Programming 27 (1983) 1; R. T. Rockafellar, SIAM J.
Control Optim. 14 (1976) 877.
"""

from collections.abc import Callable
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from qpsolvers import Solution

from solvers.adapter import Program, Stack
from solvers.built_in import BuiltInSolver, Setting
from solvers.core import CAPPED, bindings, padded
from solvers.protocol import Matrix, Vector

COUNTS = ("exchanges", "refinements", "proximal_steps")
"""The counters in the head of the state, in their order (BoxHead in box.h)."""


class BoxActiveSet(BuiltInSolver):
    """Exact box QP solver, cold or warm; it has no tolerance, so its ladder has one rung.

    Settings
    --------
    warm : bool, default False
        Whether ``solve()`` starts from the last active set, so that its time depends on earlier solves. If not, it
        starts from "all free" and the answer depends on the data alone, to the last bit. ``solve(x)`` always starts
        from the active set of x.
    most_exchanges : int, default 0
        Limit of exchanges; a solve that reaches it ends at a feasible point, from which a warm solve continues. 0 for
        no limit.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = BoxActiveSet()
    >>> s.setup(qpsolvers.Problem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [0.0, 2.0]
    """

    name = "box_active_set"
    algorithm = "dual active set"
    known = MappingProxyType({"warm": Setting(False), "most_exchanges": Setting(0, 2**31 - 1, whole=True)})

    core = "box"
    set_data = bindings.box_set_data
    run = bindings.box_solve

    def build(self, p: Program, rows: Stack) -> None:
        super().build(p, rows)
        self.x = self.field["answer"].view()
        self.x.flags.writeable = False
        self.field["cap"].view(np.int32)[0] = self.options["most_exchanges"]

    def run_from(self, start: Vector | None) -> int:
        return bindings.box_start(self.state, start) or bindings.box_solve(self.state, True)

    def loop(self) -> Callable[..., int]:
        return partial(bindings.time_box, self.state, self._warm)

    def extras(self) -> dict[str, Any]:
        """The numbers of exchanges, refinement steps and proximal steps, ``regularised`` (P is singular) and ``capped``
        (``most_exchanges`` ended the solve before the optimum)."""
        counts = dict(zip(COUNTS, self.field["counts"].view(np.int32)[: len(COUNTS)].tolist(), strict=True))
        return {
            **counts,
            "regularised": bool(self.field["singular"].view(np.int32)[0]),
            "capped": self._verdict == CAPPED,
        }

    def remember(self, P: Matrix | None, q: Vector, x: Vector) -> None:
        """The state has them."""

    def solution(self) -> Solution:
        """With P from its scaled copy, which is exact."""
        self._check_ready(self._missing)
        p, d = self.program, self.program.d
        P, scale = self.field["P"].reshape(d, padded(d))[:, :d] / self.field["cost"], self.field["scale"]
        unit = np.divide(1.0, scale, out=np.zeros(d), where=scale > 0)  # 0 for a zero row
        p.P[:], p.q[:] = P * unit * unit[:, None], self.field["raw_q"]
        return super().solution()
