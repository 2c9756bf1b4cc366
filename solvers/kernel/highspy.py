"""HiGHS by its C functions: the algorithm and settings of the direct lane, see :mod:`solvers.direct.highspy`.

Timed inside compiled code: ``update`` passes the triangle of P and q; ``solve`` sets the time limit, runs from the
start, and copies the answer and its duals.
"""

import ctypes
import weakref
from pathlib import Path

import highspy
import numpy as np

from solvers.adapter import Answer, Program, Stack, Triangle
from solvers.arrays import address
from solvers.direct import highspy as direct
from solvers.kernel._library import CompiledLibrary, open_library

IN_LOOP = (
    "Highs_passHessian",
    "Highs_changeColsCostByRange",
    "Highs_setDoubleOptionValue",
    "Highs_getRunTime",
    "Highs_run",
    "Highs_getModelStatus",
    "Highs_getSolution",
)
HIGHS = open_library(
    "highspy",
    "1.15.1",
    next(Path(highspy.__file__).parent.glob("libhighs.*"), Path("libhighs")),
    (
        "Highs_create",
        "Highs_destroy",
        "Highs_passModel",
        "Highs_setBoolOptionValue",
        "Highs_setIntOptionValue",
        "Highs_getIntInfoValue",
        *IN_LOOP,
    ),
)
HIGHS.Highs_create.restype = ctypes.c_void_p
COLUMNWISE, MINIMISE = 1, 1


class Highspy(CompiledLibrary, direct.Highspy):
    """The library's ``Highs``."""

    def build(self, p: Program, rows: Stack) -> None:
        triangle = Triangle(p.d, upper=False)
        self._highs = highs = ctypes.c_void_p(HIGHS.Highs_create())
        weakref.finalize(self, HIGHS.Highs_destroy, highs)
        options = {"output_flag": False, "threads": 1, **self.settings}
        limit = np.array([options.pop("time_limit", 5.0)])
        for option, value in options.items():
            kind = "Bool" if isinstance(value, bool) else "Int" if isinstance(value, int) else "Double"
            convert = ctypes.c_double if kind == "Double" else ctypes.c_int
            if HIGHS[f"Highs_set{kind}OptionValue"](highs, option.encode(), convert(value)) < 0:
                raise ValueError(f"highspy does not take the option {option} = {value!r}")
        R, low, high = direct.general_rows(p)
        flag = HIGHS.Highs_passModel(
            highs,
            p.d,
            low.size,
            R.nnz,
            0,
            COLUMNWISE,
            0,
            MINIMISE,
            ctypes.c_double(0.0),
            *map(address, (p.q, p.lb, p.ub, low, high, R.indptr, R.indices, R.data)),
            None,
            None,
            None,
            None,
        )
        self.refuse(flag)
        self._column_dual, self._row_dual = np.zeros(p.d), np.zeros(low.size)
        self.bind(
            highs,
            limit,
            triangle.indptr,
            triangle.indices,
            np.empty(triangle.indices.size),
            self._column_dual,
            np.empty(low.size),
            self._row_dual,
            *(HIGHS[name] for name in IN_LOOP),
        )
        self.pass_data(p.P, p.q)

    def answer(self) -> Answer:
        count, p = ctypes.c_int(), self.program
        HIGHS.Highs_getIntInfoValue(self._highs, b"qp_iteration_count", ctypes.byref(count))
        status = highspy.HighsModelStatus(HIGHS.Highs_getModelStatus(self._highs)).name.removeprefix("k")
        w = -np.concatenate([self._column_dual, self._row_dual[: p.u.size - p.d]])
        return Answer(self.x, w, status, count.value)
