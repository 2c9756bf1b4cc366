"""Numbers as C writes them, and what cannot be written."""

import math
from collections.abc import Iterable
from typing import Literal

Precision = Literal["double", "float"]
LARGEST, SMALLEST = 3.4028234e38, 1.1754944e-38
"""Of the normal numbers of single precision."""


class ExportError(ValueError):
    """An export that cannot be; the message is one sentence that says why."""


def literal(value: float, precision: Precision = "double") -> str:
    """A constant that reads back as the number; ExportError where single precision would make it infinite or lose its
    digits.

    Examples
    --------
    >>> literal(0.1), literal(-math.inf)
    ('0.1', '-INFINITY')
    """
    value = float(value)
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    if math.isnan(value):
        raise ValueError("NaN is not a constant")
    if precision == "float" and value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        raise ExportError(
            f"the constant {value:g} does not fit into single precision; export it with --precision double"
        )
    return repr(value)


def initialiser(values: Iterable[float], precision: Precision = "double") -> str:
    """An array's initialiser; what is missing at the end is zero in C.

    Examples
    --------
    >>> initialiser([0.0, 0.5])
    '{ 0.0, 0.5 }'
    """
    return "{ " + ", ".join(literal(value, precision) for value in values) + " }"
