"""Numbers as C writes them, and how many operations an exported compensator does with them.

Counts follow from the orders alone: n thresholds above zero, z dead zones, ρ creep rates, d unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

from piezo_model.structure import ModelStructure

Precision = Literal["double", "float"]


def literal(value: float, precision: Precision = "double") -> str:
    """A constant of that precision that reads back as the nearest number.

    Examples
    --------
    >>> literal(0.1), literal(2.0, "float"), literal(-math.inf)
    ('0.1', '2.0f', '-INFINITY')
    """
    value = float(value)
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    if math.isnan(value):
        raise ValueError("NaN is no constant")
    return repr(value) + ("f" if precision == "float" else "")


def initialiser(values: Iterable[float], precision: Precision = "double") -> str:
    """An array's initialiser; what is missing at the end is zero in C.

    Examples
    --------
    >>> initialiser([0.0, 0.5])
    '{ 0.0, 0.5 }'
    """
    return "{ " + ", ".join(literal(value, precision) for value in values) + " }"


def operations(s: ModelStructure, learning: bool, cyclic: bool) -> dict[str, tuple[int, int, int]]:
    """Most multiplications, additions and comparisons of one ordinary sample, by part of the work; learning with its guard."""
    n, z, rates, d = s.n + 1, s.dead_zones, len(s.creep_rates), s.d
    counts = {"compensation": (z + n * (3 + bool(rates) + rates) + 4, 4 * z + n * (8 + 5 * rates) + 6,
                               2 * z + n * (4 + 2 * rates) + 8)}
    if learning:
        row = 9 * z + 4, 4 * z + 6
        triangle = (d + 1) * (d + 2) // 2
        if cyclic:
            counts["data basis"] = (triangle + 2, triangle + row[0], row[1] + 8)
            counts["projected step"] = (d * d + 2, d * d + 2 * d + 5, d + 9)
        else:
            square = (d + 1) ** 2
            counts["exact optimum"] = (2 * square + triangle + 8 * d + 16, 2 * square + triangle + row[0] + 4 * d, row[1] + d + 12)
    return counts
