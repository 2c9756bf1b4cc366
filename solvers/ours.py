"""Metadata shared by the built-in solvers."""

from solvers.core import BUILT_WITH
from solvers.protocol import Entrant


class Ours(Entrant):
    """Licence, package and compiler."""

    licence = "MIT"
    distribution = "piezobench"
    built_with = BUILT_WITH
