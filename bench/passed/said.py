"""What a solver says of its answer, made fit for a table: whoever wrote the solver may say anything.

A count of iterations is a whole number from 0 to 2⁵³ and a time a finite one from 0 on; what is said beyond that is taken for
nothing said. Numbers of an answer and its duals are real, or the adapter has failed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from qpsolvers import Solution

from solvers.arrays import Vector

UNSAID = -1
MOST = 2**53
LONGEST = 500
"""Characters of a status."""


@dataclass(frozen=True)
class Said:
    """What a solver says of its last answer."""

    found: bool
    status: str
    """In its own words, on one line."""
    iterations: int
    """``UNSAID`` for none."""
    time_us: float
    """NaN for none."""
    y: Vector | None
    z: Vector | None
    z_box: Vector | None
    """Duals in qpsolvers' conventions."""

    @classmethod
    def of(cls, solution: Solution) -> Said:
        """Take it from a solution and its extras.

        ValueError where duals are no real numbers.
        """
        extras = solution.extras or {}
        count, time_us = _number(extras.get("iterations", extras.get("steps"))), _number(extras.get("reported_us"))
        return cls(bool(solution.found), " ".join(str(extras.get("status", "")).split())[:LONGEST],
                   int(count) if count <= MOST and count.is_integer() else UNSAID, time_us,
                   *(None if dual is None else real(dual) for dual in (solution.y, solution.z, solution.z_box)))


def real(values: Any) -> Vector:
    """Numbers as an array of our own, so that nothing of a library's is kept; ValueError where they are complex.

    Examples
    --------
    >>> real([1, 2])
    array([1., 2.])
    """
    found = np.array(values)
    if np.iscomplexobj(found):
        raise ValueError("answers with complex numbers")
    return found.astype(np.float64)


def _number(value: Any) -> float:
    """A number from 0 on; NaN for whatever else was said."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return number if 0.0 <= number < math.inf else math.nan
