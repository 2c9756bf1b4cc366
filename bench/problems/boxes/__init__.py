"""Two hundred small programs with bounds, for the tests of any solver: the same bits everywhere, and for ever.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

They are stored in ``programs.npz``: forty of each kind that ``examples/problem_sets/make_boxes.py`` draws, and forty
from identification. License of the data: CC BY 4.0.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from bench.problem_files.npz import opened, unpacked_program
from bench.problem_files.program import ReadProgram
from bench.problems.foreign import ForeignPrograms, Source

DATA = Path(__file__).with_name("programs.npz")


class Boxes(ForeignPrograms):
    """The stored programs, by kind."""

    name = "boxes"
    description = "200 small programs with bounds, for a solver's own tests: ill-conditioned, degenerate, scaled"
    takes: ClassVar = {}

    def sources(self) -> Sequence[tuple[str, Source]]:
        """Name of each program, and what makes it."""
        with opened(DATA) as arrays:
            names = dict.fromkeys(key.partition("/")[0] for key in arrays)
            return [(name, partial(ReadProgram, unpacked_program(arrays, f"{name}/"))) for name in names]
