"""What the values of columns tell where names do not: time never falls, and an index increases by one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_model.recordings.table import ABSURD, Table
from solvers.arrays import Vector

ROWS = 1_000_000
"""Rows from the start that are looked at."""


@dataclass(frozen=True)
class Profile:
    """One column, values apart that are missing or absurd."""

    low: float
    high: float
    rises: bool
    """Never falls, and is not constant."""
    counts: bool
    """Increases by one in every row: an index."""
    uniform: bool
    """Increases nearly evenly."""


def profiles(table: Table, columns: Sequence[int]) -> dict[int, Profile]:
    """Profiles of columns by position."""
    return (
        {k: _profile(values) for k, values in zip(columns, table.read(columns, slice(ROWS)), strict=True)}
        if columns
        else {}
    )


def _profile(values: Vector) -> Profile:
    known = values[np.abs(values) < ABSURD]
    if known.size < 2:
        known = np.zeros(2)
    steps = np.diff(known)
    least, most = float(steps.min()), float(steps.max())
    return Profile(
        float(known.min()),
        float(known.max()),
        rises=least >= 0.0 < most,
        counts=least == most == 1.0,
        uniform=most - least <= 0.5 * float(steps.mean()),
    )
