"""The solvers' arithmetic in C99, and the extension module through which Python calls it.

The headers of this folder document the functions, README.md how the core is built and extended. ``bindings`` is the
extension module for the best instruction set of this processor; PIEZOBENCH_ISA=v2 (v3, v4) selects another, for tests
and measurements.
"""

import importlib.util
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.core.compile_core import digest, instruction_sets, library

(OK, UNBOUNDED, INDEFINITE, MAX_EXCHANGES, NOT_FINITE, CROSSED, ASYMMETRIC, BREAKDOWN, CAPPED, UNSET) = range(10)
UNSOLVED = -1
REASONS = {
    UNSOLVED: "not solved yet",
    OK: "solved",
    UNBOUNDED: "the problem is unbounded below: q points down a direction in which P has no curvature above its "
    "rounding, and no bound stops",
    INDEFINITE: "P is indefinite beyond rounding, so the problem is not convex",
    MAX_EXCHANGES: "no active set met the optimality conditions within the limit of exchanges",
    NOT_FINITE: "P, q and a starting point must be finite and bounds must not be NaN",
    CROSSED: "a lower bound lies above its upper bound or at +inf, or an upper bound at -inf",
    ASYMMETRIC: "P is not symmetric",
    BREAKDOWN: "P is too close to indefinite even with the proximal term",
    CAPPED: "the limit of exchanges or steps was met before the optimum",
    UNSET: "P and q are not set yet",
}
"""Sentences for the statuses of status.h, and for data without a solve."""


def load(package: Path, level: int | None = None) -> ModuleType:
    """Load the extension module of a package's core.

    Parameters
    ----------
    package : Path
        Folder of the package.
    level : int, optional
        x86-64 level of the processor; by default the module itself determines it.

    Raises
    ------
    ImportError
        It is not built, it was built from other sources, or PIEZOBENCH_ISA selects an instruction set that is missing.
    """
    best = instruction_sets()[0]
    module = _open(package, best)
    if level is None:
        level = module.processor_level()
    if best != "native":
        selected = os.environ.get("PIEZOBENCH_ISA") or f"v{level}"
        possible = [isa for isa in instruction_sets() if int(isa[1:]) <= level]
        if selected not in possible:
            raise ImportError(f"the instruction set {selected} is not one of {', '.join(possible)} of this processor")
        module = module if selected == best else _open(package, selected)
    if module.sources != digest(package):
        raise ImportError(
            f"the C sources in {package.name}/core have changed since their library was built: run make core"
        )
    return module


def _open(package: Path, instructions: str) -> ModuleType:
    path = library(package, instructions)
    if not path.exists():
        raise ImportError(f"the C core of {package.name} is not built: run make core")
    # Python fills the module of a name anew if another library has the same name
    return module_at(f"{package.name}.core.{instructions}._core", path)


def module_at(name: str, path: Path) -> ModuleType:
    """Import a file as the module of a name; ImportError if it is not a Python file."""
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def padded(size: int) -> int:
    """The next multiple of eight."""
    return -(-size // 8) * 8


def block(size: int) -> NDArray[np.uint8]:
    """Zero bytes that begin on a cache line: the memory of a state, which is saved and restored by its bytes."""
    raw = np.zeros(size + 64, dtype=np.uint8)
    skip = -raw.ctypes.data % 64
    return raw[skip : skip + size]


def field_views(state: NDArray[np.uint8], offsets: Mapping[str, tuple[int, int]]) -> dict[str, NDArray[np.float64]]:
    """Views of the fields of a state by name; ``offsets`` has the offset of each in bytes and its length in doubles."""
    return {name: state[at : at + 8 * length].view(np.float64) for name, (at, length) in offsets.items()}


bindings: Any = load(Path(__file__).parents[1])
BUILT_WITH = f"{bindings.compiler}, {bindings.instructions}"
"""Compiler and instruction set; times depend on them, answers do not."""
