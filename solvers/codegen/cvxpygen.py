"""Solvers behind CVXPYgen: a problem with parameters, written as C around a solver's own C.

    minimise ½ ‖S x‖² + qᵀx   subject to   lower ≤ x, x ≤ upper (where finite),   with parameters S, q, lower and upper

Source: M. Schaller, G. Banjac, S. Diamond, A. Agrawal, B. Stellato, S. Boyd, "Embedded code generation with CVXPY",
IEEE Control Systems Letters 6 (2022), pages 2653 to 2658.

``quad_form(x, P)`` with a parameter P violates the rules of disciplined parametrised programming, so the parameter is S
with SᵀS = P, here the upper Cholesky factor; the solver gets d more variables S x and d more equations, ECOS a cone.
Timed: ``update`` factorises P into S and sets the parameters; ``solve`` is ``cpg_solve``, which inserts them into the
solver's data, factorises and solves, always cold. SCS allocates a new workspace for new data.
"""

import contextlib
import importlib.util
import io
import json
import shlex
import shutil
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from solvers.backend import ECOS, OSQP, QOCO, SCS
from solvers.codegen._build import COMPILER, Sources, run
from solvers.codegen._embedded import Embedded, Shape, generator
from solvers.protocol import Solver

if importlib.util.find_spec("cvxpygen") is None:
    raise ImportError("No module named 'cvxpygen'")

SOLVERS = {
    name: generator(known.algorithm, known.licence, "cvxpygen")
    for name, known in {"ecos": ECOS, "osqp": OSQP, "qoco": QOCO, "scs": SCS}.items()
}
"""cvxpygen_<solver>.c has the C that differs between them."""


class Cvxpygen(Embedded):
    """One solver behind ``cvxpygen.cpg.generate_code``, a subclass made by :func:`make`."""

    glue = ("cvxpygen.c",)

    def generate(self, shape: Shape, folder: Path) -> Sources:
        written = folder / "cpg"
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")  # cvxpy and CVXPYgen warn about each other
            from cvxpygen import cpg  # imports cvxpy, which takes seconds

            cpg.generate_code(
                _problem(shape),
                code_dir=str(written),
                solver=self.name.removeprefix("cvxpygen_").upper(),
                wrapper=False,
            )
        lower, upper = ("d0" if shape.below else "none"), ("d1" if shape.below and shape.above else "d0")
        names = [
            f"-DDUAL_LOWER={lower if shape.below else upper}",
            f"-DDUAL_UPPER={upper if shape.above else lower}",
            f"-DUPDATE_LOWER={'cpg_update_lower' if shape.below else 'cpg_update_q'}",
            f"-DUPDATE_UPPER={'cpg_update_upper' if shape.above else 'cpg_update_q'}",
        ]
        found = _sources(written / "c")
        return Sources(found.files, (*found.options, *names))


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


def _sources(folder: Path) -> Sources:
    """The files and options of CVXPYgen's CMake project, whose configuration also fills in templates."""
    beside = shutil.which("cmake", path=str(Path(sys.executable).parent)) or "cmake"
    run(
        [
            beside,
            "-S",
            folder,
            "-B",
            folder / "build",
            "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON",
            f"-DCMAKE_C_COMPILER={COMPILER}",
            "-G",
            "Unix Makefiles",
        ],
        folder,
    )
    compiled = json.loads((folder / "build" / "compile_commands.json").read_text(encoding="utf-8"))
    # The project also has examples, and targets of the solver itself with the same files.
    wanted = [each for each in compiled if "/cpg.dir/" in each["command"] or "/solver_code/lib/" in each["file"]]
    words = [word for each in wanted for word in shlex.split(each["command"]) if word.startswith(("-I", "-D"))]
    return Sources(tuple(dict.fromkeys(Path(each["file"]) for each in wanted)), tuple(dict.fromkeys(words)))


def make(name: str) -> type[Solver]:
    """The class of one solver, cvxpygen_osqp for OSQP.

    Raises
    ------
    ImportError
        There is none of that name.
    """
    solver = name.removeprefix("cvxpygen_")
    if solver not in SOLVERS:
        raise ImportError(f"CVXPYgen has no solver {solver!r} here")
    described = {"__doc__": f"{solver} behind CVXPYgen.", "name": name, "library": SOLVERS[solver]}
    return type(name, (Cvxpygen,), described)
