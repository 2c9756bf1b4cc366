"""What a solver says of its answer, made fit for a table: whoever wrote the solver may say anything.

A count of iterations is a whole number from 0 to 2⁵³ and a time a finite one from 0 on; what is said beyond that is
taken for nothing said. Numbers of an answer and its duals are real, or the adapter has failed.
"""

import math
from typing import Any

import numpy as np
from qpsolvers import Solution

from solvers.arrays import Vector

UNSAID = -1
MOST = 2**53
LONGEST = 500
"""Characters of a status."""


def solver_info(solution: Solution) -> dict[str, Any]:
    """What a solver says of its last answer, with its duals, by the names that an outcome has for it.

    ValueError where duals are not real numbers.
    """
    extras = solution.extras or {}
    count, time_us = _number(extras.get("iterations", extras.get("steps"))), _number(extras.get("reported_us"))
    duals = {name: getattr(solution, name) for name in ("y", "z", "z_box")}
    return {
        "found": bool(solution.found),
        "solver_status": " ".join(str(extras.get("status", "")).split())[:LONGEST],
        "iterations": int(count) if count <= MOST and count.is_integer() else UNSAID,
        "reported_us": time_us,
        **{name: None if dual is None else real(dual) for name, dual in duals.items()},
    }


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
