"""What is said of every solver that was written for this project and compiled with it."""

from __future__ import annotations

from solvers.core import BUILT_WITH
from solvers.protocol import Entrant


class Ours(Entrant):
    """Licence, package and compiler."""

    licence = "MIT"
    distribution = "piezobench"
    built_with = BUILT_WITH
