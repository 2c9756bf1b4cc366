"""eiquadprog: the dual active set method of Goldfarb and Idnani in C++ on Eigen, as robots use it.

    minimise ½ xᵀP x + gᵀx   subject to   E x + e = 0,  C x + c ≥ 0;   g = q

Source: D. Goldfarb and A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
Mathematical Programming 27 (1983), pages 1 to 33; the package eiquadprog of the project stack-of-tasks.

The package has no module for Python, so its class is called by the C++ names of its functions, on our memory: a matrix
of Eigen is an address and its numbers of rows and columns, stored by columns. The layout of the class belongs to one
version.

Timed: ``update`` copies; ``solve`` is the library's function, which factorises and iterates. It has no tolerance and no
warm start. It does not look whether its Cholesky factorisation succeeded, so that is read here: of an indefinite P the
answer would be wrong and called optimal.
"""

import ctypes
import weakref
from functools import partial
from importlib.metadata import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solvers.adapter import Cones, LibrarySolver, Program, Report, Vector
from solvers.arrays import address
from solvers.backend import Backend
from solvers.core import block
from solvers.kernel._library import open_library

CLASS = "_ZN10eiquadprog7solvers14EiquadprogFast"
CONSTRUCT, DESTROY, RESET = f"{CLASS}C1Ev", f"{CLASS}D1Ev", f"{CLASS}5resetEmmm"
SOLVE = (
    f"{CLASS}14solve_quadprogERKN5Eigen6MatrixIdLin1ELin1ELi0ELin1ELin1EEE"
    "RKNS3_IdLin1ELi1ELi0ELin1ELi1EEES6_S9_S6_S9_RS7_"
)
LIBRARY = open_library(
    "eiquadprog",
    "1.3.2",
    next((Path(str(f.locate())) for f in files("eiquadprog") or () if f.name.startswith("libeiquadprog.")), Path()),
    (CONSTRUCT, DESTROY, RESET, SOLVE),
)
OBJECT_BYTES = 1024
FACTORISED, MULTIPLIERS, ACTIVE, COUNTS = 116, 176, 240, 336
"""Offsets in the object: whether Cholesky failed; the addresses of u and A; numbers of active rows and iterations."""
STATUSES = ("optimal", "infeasible", "unbounded", "iteration limit", "redundant equalities", "P has no Cholesky factor")


class Eiquadprog(LibrarySolver):
    """The library's ``EiquadprogFast``."""

    library = Backend("dual active set", "LGPL-3.0-or-later", "eiquadprog")
    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n = rows.equal
        self._x, self._object = p.no_answer(), block(OBJECT_BYTES)
        # copies, since Eigen expects its numbers at multiples of 16 bytes
        constraints = (rows.R[:n].copy("F"), -rows.r[:n], -rows.R[n:].copy("F"), rows.r[n:].copy())
        self._held = p.P, p.q, *constraints, self._x
        self._matrices = [np.array([each.ctypes.data, *each.shape]) for each in self._held]
        self._solve = partial(getattr(LIBRARY, SOLVE), *map(address, (self._object, *self._matrices)))
        LIBRARY[CONSTRUCT](address(self._object))
        weakref.finalize(self, _destroy, self._object)
        LIBRARY[RESET](address(self._object), *map(ctypes.c_size_t, (p.d, n, rows.unequal)))

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        status = self._solve()
        self._status = status if self._numbers(FACTORISED, 1)[0] == 0 else len(STATUSES) - 1
        return self._x.copy() if self._status == 0 else None

    def report(self) -> Report:
        n, w = self.rows.equal, np.zeros(self.rows.r.size)
        active, _, iterations = self._numbers(COUNTS, 3).tolist()
        of_u, of_A = (int(self._object[at : at + 8].view(np.int64)[0]) for at in (MULTIPLIERS, ACTIVE))
        which = np.array((ctypes.c_int * active).from_address(of_A))
        u = np.array((ctypes.c_double * active).from_address(of_u))
        w[np.where(which < 0, -which - 1, which + n)] = np.where(which < 0, -u, u)
        return Report(self._x, w, STATUSES[self._status], iterations)

    def _numbers(self, offset: int, count: int) -> NDArray[np.intc]:
        return self._object[offset : offset + 4 * count].view(np.intc)


def _destroy(memory: NDArray[np.uint8]) -> None:
    """Free what the object in this memory has allocated."""
    LIBRARY[DESTROY](address(memory))
