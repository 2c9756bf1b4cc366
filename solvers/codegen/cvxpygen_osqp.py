"""OSQP behind CVXPYgen: a problem with parameters, written as C around the solver's own C.

    minimise ½ ‖S x‖² + qᵀx   subject to   lower ≤ x, x ≤ upper (where finite),   with parameters S, q, lower and upper

Source: M. Schaller, G. Banjac, S. Diamond, A. Agrawal, B. Stellato, S. Boyd, "Embedded code generation with CVXPY",
IEEE Control Systems Letters 6 (2022), pages 2653 to 2658.

``quad_form(x, P)`` with a parameter P violates the rules of disciplined parametrised programming, so the parameter is S
with SᵀS = P, here the upper Cholesky factor; the solver gets d more variables S x and d more equations. Timed:
``update`` factorises P into S and sets the parameters; ``solve`` is ``cpg_solve``, which inserts them into the solver's
data, factorises and solves, always cold.
"""

import contextlib
import importlib.util
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from solvers.codegen._build import Sources
from solvers.codegen._embedded import Embedded, Shape, generator

if importlib.util.find_spec("cvxpygen") is None:
    raise ImportError("No module named 'cvxpygen'")


class CvxpygenOsqp(Embedded):
    """``cvxpygen.cpg.generate_code``."""

    library = generator("ADMM", "Apache-2.0", "cvxpygen")

    def generate(self, shape: Shape, folder: Path) -> Sources:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")  # cvxpy and CVXPYgen warn about each other
            from cvxpygen import cpg  # imports cvxpy, which takes seconds

            cpg.generate_code(_problem(shape), code_dir=str(folder / "cpg"), solver="OSQP", wrapper=False)
        lower, upper = ("d0" if shape.below else "none"), ("d1" if shape.below and shape.above else "d0")
        names = (
            f"-DDUAL_LOWER={lower if shape.below else upper}",
            f"-DDUAL_UPPER={upper if shape.above else lower}",
            f"-DUPDATE_LOWER={'cpg_update_lower' if shape.below else 'cpg_update_q'}",
            f"-DUPDATE_UPPER={'cpg_update_upper' if shape.above else 'cpg_update_q'}",
        )
        written = folder / "cpg" / "c"
        osqp = written / "solver_code"
        files = (*(written / "src" / f"cpg_{part}.c" for part in ("workspace", "solve")), osqp / "workspace.c")
        folders = (written / "include", osqp, osqp / "inc" / "public", osqp / "inc" / "private")
        return Sources((*files, *sorted((osqp / "src").glob("*.c"))), (*(f"-I{each}" for each in folders), *names))


def _problem(shape: Shape) -> Any:
    import cvxpy as cp

    d, below, above = shape.d, list(shape.below), list(shape.above)
    x, q = cp.Variable(d, name="x"), cp.Parameter(d, name="q")
    S = cp.Parameter((d, d), name="S", sparsity=np.triu_indices(d))  # row by row
    constraints = []
    if below:
        constraints.append(x[below] >= cp.Parameter(len(below), name="lower"))
    if above:
        constraints.append(x[above] <= cp.Parameter(len(above), name="upper"))
    return cp.Problem(cp.Minimize(0.5 * cp.sum_squares(S @ x) + q @ x), constraints)
