"""How times were rounded before they were written: to decimals, to significant digits, or to single precision.

Jitter that such rounding explains is no defect of a recording (:mod:`piezo_model.recordings.checks`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solvers.arrays import Vector

MOST_DECIMALS = 15
FEW = 8
SINGLE_GRID = 0.1
"""Greatest distance from a number of single precision, in steps of its grid, that printing explains; by chance it is
0.5."""


@dataclass(frozen=True)
class Rounding:
    """How times were rounded beside a fixed number of decimals: to a share, or to significant digits as by ``%g``."""

    share: float
    digits: int | None = None

    def at(self, times: Vector) -> float:
        """Rounding of the largest of these times."""
        largest = float(np.abs(times).max())
        if self.digits is None or not largest:
            return self.share * largest
        return float(10.0 ** (math.floor(math.log10(largest)) + 1 - self.digits))


def printed_digit(times: Vector) -> tuple[float, Rounding]:
    """Last decimal digit that all times are printed with, and the rounding that grows with them."""
    rounding = Rounding(float(np.finfo(np.float32 if _single(times) else np.float64).eps))
    decimals = _decimals(times, rounding)
    digits = _significant_digits(times, rounding, decimals)
    if digits is not None:
        rounding = Rounding(rounding.share, digits)
    return rounding.at(times) if decimals is None or digits is not None else 10.0**-decimals, rounding


def _significant_digits(times: Vector, rounding: Rounding, decimals: int | None) -> int | None:
    """Digits that ``%g`` printed, or None: it shows in that times below the last power of ten have more decimals."""
    size = np.abs(times)
    early = size < 10.0 ** math.floor(math.log10(float(size.max()) or 1.0))
    fewer = _decimals(times[~early], rounding)
    if fewer is None or fewer == decimals or min(np.count_nonzero(early), np.count_nonzero(~early)) < FEW:
        return None
    more = np.abs(np.round(times[early], fewer) - times[early]) > 4 * rounding.at(times)
    return fewer + 1 + math.floor(math.log10(float(size.max()))) if np.count_nonzero(more) > more.size / 2 else None


def _decimals(times: Vector, rounding: Rounding) -> int | None:
    """Fewest decimals that write all times, or None where rounding of another kind hides it."""
    floor = rounding.at(times)
    for decimals in range(MOST_DECIMALS + 1):
        if 10.0**-decimals <= 16 * floor:  # every number would look rounded to it
            return None
        if (np.abs(np.round(times, decimals) - times) <= 4 * floor).all():
            return decimals
    return None


def _single(times: Vector) -> bool:
    """Whether times are of single precision, be it printed in decimals: they lie on its grid far better than by
    chance."""
    some = times[times != 0.0]
    grid = np.float32(some)
    near = np.abs(grid - some) < SINGLE_GRID * np.spacing(np.abs(grid))
    return bool(near.all()) and np.unique(grid).size == np.unique(some).size
