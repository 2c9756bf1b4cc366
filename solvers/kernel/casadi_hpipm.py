"""HPIPM by its C functions for dense programs: interior point method.

    minimise ½ vᵀH v + gᵀv   subject to   A v = b,  lb ≤ v_i ≤ ub for i in idxb,  C v ≤ ug;   H = P, g = q

The direct lane, :mod:`solvers.direct.casadi_hpipm`, calls the same library with a control problem of one stage. The
settings have the names of that lane, and infinite bounds of bounded variables are replaced by numbers as there: masked
bounds crash this version.

Timed inside compiled code: ``update`` packs P and q into the library's panels; ``solve`` is ``d_dense_qp_ipm_solve``,
always cold, and the copy of its answer. Its BLASFEO is built for the target GENERIC, without kernels for a particular
processor.
"""

import numpy as np

from solvers.adapter import Program, Report, Stack
from solvers.arrays import Vector, address
from solvers.backend import HPIPM as LIBRARY
from solvers.core import block
from solvers.kernel._library import CompiledLibrary, folder, open_library

IN_LOOP = (
    "d_dense_qp_set_H",
    "d_dense_qp_set_g",
    "d_dense_qp_ipm_solve",
    "d_dense_qp_ipm_get_status",
    "d_dense_qp_sol_get_v",
)
PARTS = ("", "_sol", "_ipm_arg", "_ipm_ws")
HPIPM = open_library(
    "casadi",
    "3.8.2",
    folder("casadi") / "libhpipm.so",
    (
        "d_dense_qp_dim_set_all",
        "d_dense_qp_set",
        "d_dense_qp_ipm_arg_set_default",
        "d_dense_qp_ipm_arg_set",
        "d_dense_qp_ipm_get_iter",
        "d_dense_qp_sol_get",
        *IN_LOOP,
        *(f"d_dense_qp{part}_{what}" for part in ("_dim", *PARTS) for what in ("strsize", "memsize", "create")),
    ),
)
BALANCE = 2
SETTINGS = {
    "res_g_max": "tol_stat",
    "res_b_max": "tol_eq",
    "res_d_max": "tol_ineq",
    "res_m_max": "tol_comp",
    "iter_max": "iter_max",
    "lam_min": "lam_min",
    "t_min": "t_min",
}
"""From the names of the direct lane to the library's own."""
MESSAGES = (
    "success",
    "maximum iterations reached",
    "minimum step length reached",
    "NaN in the solution",
    "inconsistent equalities",
)


class CasadiHpipm(CompiledLibrary):
    """The library's dense programs."""

    library = LIBRARY
    refuses_crossing = True

    def build(self, p: Program, rows: Stack) -> None:
        infinity = 1e6 if self.settings else 1e8
        # With a fixed variable as a box, the feasible set would have no interior.
        fixed = p.lb == p.ub
        self._boxed = at = np.flatnonzero((np.isfinite(p.lb) | np.isfinite(p.ub)) & ~fixed)
        self._equal = np.concatenate([np.flatnonzero(fixed), np.arange(p.u.size)[p.equalities]])
        A, C = p.R[self._equal], p.G
        self._memory: list[np.ndarray] = []
        size = self._create("_dim")
        HPIPM.d_dense_qp_dim_set_all(p.d, len(A), at.size, len(C), 0, address(size))
        qp, answer, arguments = (self._create(part, size) for part in PARTS[:3])
        HPIPM.d_dense_qp_ipm_arg_set_default(BALANCE, address(arguments))
        for setting, value in self.settings.items():
            if setting not in SETTINGS:
                raise ValueError(f"{self.name} has no setting {setting}")
            number = np.array([value], dtype=np.intc if setting == "iter_max" else np.float64)
            HPIPM.d_dense_qp_ipm_arg_set(SETTINGS[setting].encode(), address(number), address(arguments))
        self._workspace, self._answer = self._create(PARTS[3], size, arguments), answer
        for field, array in {
            "H": p.P,
            "g": p.q,
            "A": A.T,
            "b": p.u[self._equal],
            "idxb": at.astype(np.intc),
            "C": C.T,
            "lg": np.full(len(C), -infinity),
            "ug": p.h,
            "lb": np.maximum(p.lb[at], -infinity),
            "ub": np.minimum(p.ub[at], infinity),
        }.items():
            if array.size:
                data = np.ascontiguousarray(array)
                HPIPM.d_dense_qp_set(field.encode(), address(data), address(qp))
        self.pack_state(qp, answer, arguments, self._workspace, *(HPIPM[name] for name in IN_LOOP))

    def _create(self, part: str, *of: np.ndarray) -> np.ndarray:
        """One of the library's objects, in our memory."""
        functions = (HPIPM[f"d_dense_qp{part}_{what}"] for what in ("strsize", "memsize", "create"))
        before = [address(each) for each in of]
        strsize, memsize, create = functions
        made, memory = block(strsize()), block(memsize(*before))
        self._memory += [*of, made, memory]
        create(*before, address(made), address(memory))
        return made

    def _multipliers(self, field: str, size: int) -> Vector:
        values = np.zeros(size)
        HPIPM.d_dense_qp_sol_get(field.encode(), address(self._answer), address(values))
        return values

    def report(self) -> Report:
        numbers, w, m = np.zeros(2, dtype=np.intc), np.zeros(self.rows.size), self.program.h.size
        HPIPM.d_dense_qp_ipm_get_status(address(self._workspace), address(numbers))
        HPIPM.d_dense_qp_ipm_get_iter(address(self._workspace), address(numbers[1:]))
        w[self._boxed] = self._multipliers("lam_ub", self._boxed.size) - self._multipliers("lam_lb", self._boxed.size)
        w[self._equal] = -self._multipliers("pi", self._equal.size)
        w[self.program.inequalities] = self._multipliers("lam_ug", m)
        return Report(self.x, w, MESSAGES[numbers[0]], int(numbers[1]))
