"""Checked copy of a solver's report on its answer; the author of a solver may report anything.

A number of iterations is an integer from 0 to MOST, and a time is finite and not negative; other values count as not
reported. Duals are real numbers, or the adapter has failed.
"""

import math
from typing import Any

import numpy as np
from qpsolvers import Solution

from bench.messages.task import MOST, one_line
from solvers.arrays import reals


def solver_info(solution: Solution) -> dict[str, Any]:
    """A solver's report on its last answer, with its duals, by the fields of an outcome; ValueError if duals are not
    real numbers."""
    extras = solution.extras or {}
    count, time_us = amount(extras.get("iterations", extras.get("steps"))), amount(extras.get("reported_us"))
    duals, verdict = (
        {name: getattr(solution, name) for name in ("y", "z", "z_box")},
        "not " * (not solution.found) + "found",
    )
    return {
        "found": bool(solution.found),
        "solver_status": one_line(extras.get("status") or verdict),
        "iterations": int(count) if count <= MOST and count.is_integer() else -1,
        "reported_us": time_us,
        **{name: None if dual is None else np.array(reals(name, dual)) for name, dual in duals.items()},
    }


def amount(value: Any) -> float:
    """A finite number that is not negative; NaN for any other value."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return number if 0.0 <= number < math.inf else math.nan
