"""MuJoCo's ``mju_boxQP`` by its C interface: the algorithm and starts of the direct lane, see
:mod:`solvers.direct.mujoco`.

Timed inside compiled code: ``update`` passes pointers to the new P and q, which the library does not copy; ``solve`` is
the library's function, from ``warm_start`` or from 0, which writes its answer to our array.
"""

from pathlib import Path

from mujoco import _functions

from solvers.adapter import Program, Report, Stack
from solvers.direct import mujoco as direct
from solvers.kernel._library import CompiledLibrary, open_library

VERSION = "4.0.1"
MUJOCO = open_library(
    "mujoco-core",
    VERSION,
    next(Path(_functions.__file__).parent.glob(f"libmujoco.*{VERSION}*"), Path(f"libmujoco {VERSION}")),
    ("mju_boxQP",),
)


class Mujoco(CompiledLibrary, direct.Mujoco):
    """The library's ``mju_boxQP``."""

    refuses_crossing = True

    def build(self, p: Program, rows: Stack) -> None:
        super().build(p, rows)
        self.pack_state(self.lb, self.ub, self._factor, MUJOCO.mju_boxQP, 0)

    def report(self) -> Report:
        self.outcome = direct.outcome(self.x, int(self.state[-1]))
        return super().report()
