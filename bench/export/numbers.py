"""Numbers as C writes them, and how many of them an exported compensator keeps and works on.

Counts follow from the orders alone: n thresholds above zero, z dead zones, ρ creep rates, d unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

from piezo_model.structure import ModelStructure

Precision = Literal["double", "float"]
BYTES: dict[Precision, int] = {"double": 8, "float": 4}


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


def axis_bytes(s: ModelStructure, precision: Precision, learning: bool, cyclic: bool, block: int) -> int:
    """Size of a ``piezo_axis``, alignment included up to a few bytes."""
    def padded(count: int) -> int:
        return -(-count // block) * block

    play, zones, rates, n = padded(s.n + 1), padded(s.dead_zones), len(s.creep_rates), s.n + 1
    creep = bool(rates)
    weights = n + s.dead_zones + n * creep + 1
    model = weights + 4 * play + zones + play * creep
    state = play * (1 + rates * (2 if precision == "float" else 1)) + 3
    reals, wides, integers = model + state + 5, 0, 0
    if learning:
        lead = padded(s.d + 1)
        reals += play * creep + 5  # the guard's memory
        wides, integers = lead, 7
        if cyclic:
            reals += 6 + play * (3 if creep else 1)
            wides += 2 * (s.d + 1) * lead + s.d * lead + 5 * lead + s.d * (s.d + 1) + s.d
            integers += 1
        else:
            reals += 4
            swept, swept_integers = 2 * (s.d + 1) * lead + 7 * lead + 1, s.d + 4
            wides += 2 * lead + 4 + 4 * swept + 3 * (lead + 1)
            integers += 10 + 4 * (swept_integers + swept_integers % 2)
    return -(-(reals * BYTES[precision] + 8 * wides + 4 * integers) // 8) * 8


def constant_bytes(s: ModelStructure, precision: Precision, learning: bool) -> int:
    """Thresholds, gains, limits of dead zones and weights."""
    zones = s.dead_zones * (4 if learning else 2)
    return BYTES[precision] * (s.lanes + len(s.creep_rates) + zones + 2 * (s.n + 1) + s.dead_zones + 1)


def operations(s: ModelStructure, learning: bool, cyclic: bool) -> dict[str, str]:
    """Multiplications, additions and comparisons of one ordinary sample, by part of the work."""
    n, z, rates, d = s.n + 1, s.dead_zones, len(s.creep_rates), s.d
    counts = {"compensation": (z + n * (3 + bool(rates) + rates) + 4, 4 * z + n * (8 + 5 * rates) + 6,
                               2 * z + n * (4 + 2 * rates) + 6)}
    if learning:
        row = 9 * z + 4, 4 * z + 6
        triangle = (d + 1) * (d + 2) // 2
        if cyclic:
            counts["data basis"] = (triangle, triangle + row[0], row[1])
            counts["projected step"] = (d * d, d * d + 2 * d, d)
        else:
            square = (d + 1) ** 2
            counts["exact optimum"] = (2 * square + triangle + 5 * d, 2 * square + triangle + row[0] + 4 * d, row[1] + d)
    return {name: f"at most {a} multiplications, {b} additions, {c} comparisons" for name, (a, b, c) in counts.items()}
