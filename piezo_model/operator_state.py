"""States and parameters of the operators of a structure, in the layout of the core.

The operators come in blocks of eight (``solvers/core/vec8.h``). Play and creep share the thresholds r_0 = 0 < r_1 < … <
r_n, padded with zeros to a multiple of eight, the structure's ``lanes``; creep states are ordered by rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.core import State, Stateful
from piezo_model.json_file import Number
from piezo_model.operators import creep_gain, dead_zone_limits
from piezo_model.structure import ModelStructure, StructureError
from solvers.arrays import Vector, reals
from solvers.core import padded

ROUNDING = 1e-12
"""Distance from its limits, as a share of their width, at which a drive is still at a limit."""


class States(TypedDict):
    """States as JSON types, without padding: play (n + 1), creep (rates, n + 1)."""

    play: list[Number]
    creep: list[list[Number]]


@dataclass
class OperatorState(Stateful):
    """States of the play and creep operators, in normalised units.

    Attributes
    ----------
    play : array (lanes,)
        Output of each play at the last sample; the first, of threshold 0, is the last input, and so is padding.
    creep : array (rates · lanes,)
        Creep states at the next sample, rate by rate.

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=3, m=0, x_range=(0, 100), y_range=(-1, 1), creep_rates=(1.0,),
    ...                                        sample_time=1e-3)
    >>> OperatorState.settled_at(structure, 75.0, came_from="above").play[:4].tolist()
    [0.5, 0.75, 1.0, 1.25]
    """

    play: Vector
    creep: Vector

    def __post_init__(self) -> None:
        self.play, self.creep = (reals(name, getattr(self, name)) for name in ("play", "creep"))

    @classmethod
    def settled_at(
        cls, structure: ModelStructure, x: float, came_from: Literal["above", "below"] | None = None
    ) -> OperatorState:
        """States after a long time at a constant input.

        Parameters
        ----------
        structure : ModelStructure
        x : float
            In the structure's input unit.
        came_from : "above" or "below", optional
            The direction of the last long movement, over more than twice the largest threshold. By default the actuator
            was driven through the structure's range with oscillations that decayed to x: in the middle of the range
            this demagnetises it, so that no play is displaced, and at the low end it is the same as from above.

        Raises
        ------
        ValueError
            If x is not finite, or the direction is another one.
        """
        checks.finite(x=x)
        checks.require(lambda value: value in ("above", "below", None), "'above', 'below' or None", came_from=came_from)
        unit_x = (x - structure.x_centre) / structure.x_scale
        slopes = {"above": 1.0, "below": -1.0, None: max(-1.0, min(1.0, -unit_x))}  # dz/dr over the thresholds
        z = unit_x + slopes[came_from] * padded_thresholds(structure)
        return cls(z, np.tile(z, len(structure.creep_rates)))

    @classmethod
    def before_drive(
        cls, structure: ModelStructure, x_limits: tuple[float, float] | None = None, x_start: float | None = None
    ) -> OperatorState:
        """States settled at the position of the stage before the first drive; see :func:`drive_start`.

        The limits are the structure's range by default.
        """
        return cls.settled_at(
            structure, float(drive_start(*(structure.x_range if x_limits is None else x_limits), x_start))
        )

    def check_fits(self, structure: ModelStructure) -> None:
        """Raise ValueError if the states do not have the size of a structure, or are not finite."""
        checks.instance(OperatorState, state=self)
        needed = structure.lanes, len(structure.creep_rates) * structure.lanes
        checks.check(
            (self.play.shape, self.creep.shape) == ((needed[0],), (needed[1],)),
            f"the operator states are those of another structure: {self.play.size} of play and "
            f"{self.creep.size} of creep where {needed[0]} and {needed[1]} are needed",
        )
        checks.finite_arrays(play=self.play, creep=self.creep)

    def to_dict(self, structure: ModelStructure) -> States:
        """The states as JSON types."""
        return {
            "play": self.play[: structure.n + 1].tolist(),
            "creep": self.creep.reshape(-1, structure.lanes)[:, : structure.n + 1].tolist(),
        }

    @classmethod
    def from_dict(cls, states: Mapping[str, Any], structure: ModelStructure) -> OperatorState:
        """Make the states of :meth:`to_dict`; ValueError if they do not have the size of the structure."""
        play, creep = states["play"], states["creep"]
        rates, size = len(structure.creep_rates), structure.n + 1
        checks.check(
            np.shape(play) == (size,) and len(creep) == rates and all(np.shape(z) == (size,) for z in creep),
            f"the operator states are not {size} numbers of play and {rates} times {size} of creep",
        )
        play = np.asarray(play, dtype=np.float64)
        padded_creep = np.full((rates, structure.lanes), play[0])
        padded_creep[:, :size] = np.array(creep, dtype=np.float64).reshape(rates, size)
        return cls(pad(play, structure.lanes, float(play[0])), padded_creep.ravel())

    def rescaled_to(self, structure: ModelStructure, other: ModelStructure) -> OperatorState:
        """Convert the states to the thresholds and input range of another structure with the same creep rates.

        Beyond the largest old threshold the last state is used; a drive through the range erases its error.
        """
        scale, shift = other.x_scale / structure.x_scale, (other.x_centre - structure.x_centre) / structure.x_scale
        r, thresholds = structure.thresholds, scale * other.thresholds

        def read(states: Vector) -> Vector:
            return (np.interp(thresholds, r, states[: structure.n + 1]) - shift) / scale

        return self.from_dict(
            {"play": read(self.play), "creep": [read(z) for z in self.creep.reshape(-1, structure.lanes)]}, other
        )

    def copy(self) -> OperatorState:
        """Return an independent copy."""
        return OperatorState(self.play.copy(), self.creep.copy())


def drive_start(low: ArrayLike, high: ArrayLike, x_start: ArrayLike | None = None) -> Vector:
    """The drive at which the stage rests before the first sample, and from which a rate limit applies.

    Parameters
    ----------
    low, high : float or array (count,)
        Limits of the drive.
    x_start : float or array (count,), optional
        By default at rest: 0, or the limit nearest to 0.

    Returns
    -------
    array () or (count,)

    Raises
    ------
    StructureError
        It is outside the limits, by more than their rounding: those of a model follow from centre and scale.

    Examples
    --------
    >>> [float(drive_start(*limits)) for limits in ((0.0, 150.0), (-20.0, 120.0), (5.0, 100.0))]
    [0.0, 0.0, 5.0]
    """
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    x = np.clip(0.0, low, high) if x_start is None else reals("x_start", x_start)
    checks.check(
        x.shape in ((), low.shape),
        f"x_start must be one number or one for each actuator, not of shape {x.shape}",
        StructureError,
    )
    x, width = np.broadcast_to(x, low.shape), high - low
    inside = np.clip(x, low, high)
    for i in np.flatnonzero(~(np.abs(x - inside) <= np.where(np.isfinite(width), ROUNDING * width, 0.0))):
        raise StructureError(
            f"x_start{f'[{i}]' if x.ndim else ''} must be within the limits of the drive, {low.flat[i]:g} to "
            f"{high.flat[i]:g}, not {x.flat[i]:g}"
        )
    return inside


def operator_arrays(structure: ModelStructure, dead_zones: ArrayLike) -> dict[str, Vector]:
    """Thresholds and gains of play and creep, and limits of dead zones, by their names in ``core/operators.h``."""
    low, high = dead_zone_limits(dead_zones)
    return {
        "r": padded_thresholds(structure),
        "a": creep_gain(structure.creep_rates, structure.sample_time),
        "low": pad(low, padded(low.size), -np.inf),
        "high": pad(high, padded(high.size), np.inf),
    }


def write_operators(core: State, structure: ModelStructure, dead_zones: ArrayLike) -> None:
    """Write the arrays of the operators to a state of the core."""
    for name, values in operator_arrays(structure, dead_zones).items():
        core[name][:] = values


def padded_thresholds(structure: ModelStructure) -> Vector:
    """Thresholds (lanes,) of play and creep."""
    return pad(structure.thresholds, structure.lanes)


def pad(values: Vector, size: int, filling: float = 0.0) -> Vector:
    """Append a filling value up to ``size`` values."""
    return np.concatenate([values, np.full(size - values.size, filling)])
