"""The structure of a model, everything but its weights: orders, thresholds, creep rates, ranges and units.

Internally, amplitudes and thresholds are in normalised units, x̃ = (x − x_centre) / x_scale and
ỹ = (y − y_centre) / y_scale; externally, everything is in the units of the user. If the output falls as the input
rises, y_scale < 0, which reverses the sign of the output and nothing else. The order of the unknowns of the
identification (5), with w_H0 = 1, is


    w = (w_H1 … w_Hn,  w'_S,−m … w'_S0 … w'_Sm,  w_K0 … w_Kn,  [offset])        d = n + (2m + 1) + (n + 1) [+ 1]

In *slope coordinates* v the 2m + 1 weights w'_S are replaced by their partial sums outwards from zero, the slopes of
the piecewise linear S⁻¹ (``slope_map``), so that the admissible set is a box (``lower_bounds``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from piezo_model import checks
from piezo_model.core import Immutable
from piezo_model.json_file import LARGEST
from piezo_model.units import conversion
from solvers.arrays import Matrix, Vector, read_only, reals
from solvers.core import padded

SMALLEST = 1.0 / LARGEST
SAMPLE_TIMES = 1e-9, 1e9
RANGES: Mapping[str, tuple[float, float]] = {
    "play_thresholds": (0.0, LARGEST),
    "dead_zone_thresholds": (-LARGEST, LARGEST),
    "creep_rates": (SMALLEST, LARGEST),
    "sample_time": SAMPLE_TIMES,
    "x_centre": (-LARGEST, LARGEST),
    "x_scale": (SMALLEST, LARGEST),
    "y_centre": (-LARGEST, LARGEST),
    "y_scale": (-LARGEST, LARGEST),
}
LONGEST_UNIT = 1000


class StructureError(ValueError):
    """An invalid model structure, or a start of the drive outside its limits; the message is a sentence that names the
    field."""


@dataclass(frozen=True)
class ModelStructure(Immutable):
    """Orders, thresholds, creep rates, ranges and units of a modified Prandtl–Ishlinskii model with creep.

    Parameters
    ----------
    play_thresholds : sequence of n floats
        0 < r_H1 < … < r_Hn in normalised units; r_H0 = 0 is implied. Creep has the same thresholds.
    dead_zone_thresholds : sequence of 2m + 1 floats
        Ascending, including 0, in normalised units: the thresholds r'_S of S⁻¹, not necessarily as many on each side.
    creep_rates : sequence of floats
        In 1/s; the states of all rates at one threshold share one weight. Empty for a model without creep.
    sample_time : float
        Sampling period Ts in s.
    x_centre, x_scale, y_centre, y_scale : float
        In the units of input and output; the scales are half the ranges, y_scale < 0 for a falling output.
    offset : bool
        Whether a constant is identified with the weights; real sensors have one.
    input_unit, output_unit : str

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=5, m=3, x_range=(0.0, 150.0), y_range=(-20.0, 20.0),
    ...                                        creep_rates=(10.0, 1.0, 0.1), sample_time=125e-6)
    >>> structure.d
    18
    >>> structure.weight_names[4:7]
    ('w_H5', "w'_S-3", "w'_S-2")
    """

    play_thresholds: tuple[float, ...]
    dead_zone_thresholds: tuple[float, ...]
    creep_rates: tuple[float, ...]
    sample_time: float
    x_centre: float
    x_scale: float
    y_centre: float
    y_scale: float
    offset: bool = False
    input_unit: str = "V"
    output_unit: str = "um"

    def __post_init__(self) -> None:
        with checks.refusing(StructureError):
            for name in ("play_thresholds", "dead_zone_thresholds", "creep_rates"):
                object.__setattr__(self, name, tuple(checks.vectors(**{name: getattr(self, name)})[0].tolist()))
            for name, (least, most) in RANGES.items():
                checks.require(
                    lambda value, a=least, b=most: np.all(np.less_equal(a, value) & np.less_equal(value, b)),  # type: ignore[misc]
                    f"from {least:g} to {most:g}",
                    **{name: getattr(self, name)},
                )
            for name in ("sample_time", "x_centre", "x_scale", "y_centre", "y_scale"):
                object.__setattr__(self, name, float(getattr(self, name)))
            object.__setattr__(self, "offset", bool(self.offset))
            checks.require(
                lambda r: all(a < b for a, b in pairwise((0.0, *r))),
                "positive and ascending",
                play_thresholds=self.play_thresholds,
            )
            checks.require(
                lambda r: 0.0 in r and all(a < b for a, b in pairwise(r)),
                "ascending with 0 among them",
                dead_zone_thresholds=self.dead_zone_thresholds,
            )
            checks.require(lambda scale: abs(scale) >= SMALLEST, f"at least {SMALLEST:g} from 0", y_scale=self.y_scale)
            checks.require(
                lambda unit: isinstance(unit, str) and len(unit) <= LONGEST_UNIT,
                f"a unit of at most {LONGEST_UNIT} characters",
                input_unit=self.input_unit,
                output_unit=self.output_unit,
            )
            checks.check(
                len(set(self.creep_rates)) == len(self.creep_rates),
                f"creep_rates must differ from each other, not {self.creep_rates}",
            )

    def samples(self, seconds: float) -> int:
        """Number of samples in a duration in s, at least one."""
        return max(1, round(seconds / self.sample_time))

    @classmethod
    def equidistant(
        cls,
        n: int,
        m: int,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        creep_rates: Sequence[float],
        sample_time: float,
        *,
        offset: bool = False,
        input_unit: str = "V",
        output_unit: str = "um",
    ) -> Self:
        """Equidistant thresholds over the amplitude range, as in the paper: r_Hi = i/(n+1), r'_Si = i/(m+1).

        Give ``y_range`` in descending order if the output falls as the input rises.
        """
        with checks.refusing(StructureError):
            checks.require(
                lambda order: isinstance(order, int) and 0 <= order <= 1000,  # more than any stage needs
                "a whole number from 0 to 1000",
                n=n,
                m=m,
            )
            checks.ascending(x_range=x_range)
            checks.require(
                lambda pair: len(pair) == 2 and -LARGEST <= min(ends := reals("", pair)) < max(ends) <= LARGEST,
                "two finite numbers that differ",
                y_range=y_range,
            )
        (x_centre, x_scale), (y_centre, y_scale) = map(_centre_and_scale, (x_range, y_range))
        return cls(
            tuple(i / (n + 1) for i in range(1, n + 1)),
            tuple(i / (m + 1) for i in range(-m, m + 1)),
            creep_rates,  # type: ignore[arg-type]
            sample_time,
            x_centre,
            x_scale,
            y_centre,
            y_scale,
            offset,
            input_unit,
            output_unit,
        )

    @property
    def negative_gain(self) -> bool:
        """Whether the output falls as the input rises."""
        return self.y_scale < 0.0

    def reversed_output(self) -> Self:
        """The same structure for an output of opposite sign.

        Examples
        --------
        >>> structure = ModelStructure((), (-0.25, 0.0, 0.75), (), 1e-3, 0.5, 0.5, 4.0, 4.0)
        >>> structure.reversed_output().negative_gain, structure.reversed_output().dead_zone_thresholds
        (True, (-0.75, 0.0, 0.25))
        """
        return replace(
            self,
            y_scale=-self.y_scale,
            dead_zone_thresholds=tuple(0.0 - r for r in reversed(self.dead_zone_thresholds)),
        )

    def in_units(self, input_unit: str, output_unit: str, name: str = "structure") -> Self:
        """Return the structure in other units; values whose unit is unknown are kept.

        Raises
        ------
        UnitError
            A unit measures something else; the message begins with ``name``.

        Examples
        --------
        >>> structure = ModelStructure.equidistant(n=5, m=3, x_range=(0.0, 150.0), y_range=(-20.0, 20.0),
        ...                                        creep_rates=(), sample_time=1e-3)
        >>> structure.in_units("V", "nm").y_scale
        20000.0
        """
        gain_x, _ = conversion(name, "input", self.input_unit, input_unit)
        gain_y, _ = conversion(name, "output", self.output_unit, output_unit)
        return replace(
            self,
            x_centre=gain_x * self.x_centre,
            x_scale=gain_x * self.x_scale,
            y_centre=gain_y * self.y_centre,
            y_scale=gain_y * self.y_scale,
            input_unit=input_unit or self.input_unit,
            output_unit=output_unit or self.output_unit,
        )

    @property
    def x_range(self) -> tuple[float, float]:
        """Range of the input, in its unit."""
        return self.x_centre - self.x_scale, self.x_centre + self.x_scale

    @property
    def n(self) -> int:
        """Order of hysteresis and creep: number of play thresholds above zero."""
        return len(self.play_thresholds)

    @property
    def dead_zones(self) -> int:
        """Number of weights of the superposition operator, 2m + 1 when both sides have m thresholds."""
        return len(self.dead_zone_thresholds)

    @property
    def middle(self) -> int:
        """Index of the threshold zero among the dead zones."""
        return self.dead_zone_thresholds.index(0.0)

    @property
    def creep_weights(self) -> int:
        """Number of creep weights: n + 1, or none without creep rates."""
        return self.n + 1 if self.creep_rates else 0

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The core's ``Shape``: numbers of thresholds n, dead zones and creep rates, and 1 with an offset."""
        return self.n, self.dead_zones, len(self.creep_rates), int(self.offset)

    @property
    def lanes(self) -> int:
        """Number of thresholds of play and creep, padded to whole blocks of eight (``solvers/core/vec8.h``)."""
        return padded(self.n + 1)

    @property
    def d(self) -> int:
        """Number of unknowns."""
        return self.n + self.dead_zones + self.creep_weights + self.offset

    @cached_property
    def thresholds(self) -> Vector:
        """The thresholds 0 = r_0 < r_1 < … < r_n of play and creep, shape (n + 1,)."""
        return read_only((0.0, *self.play_thresholds))

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        """Slices of w_H1…n, w'_S and w_K in w."""
        a, b = self.n, self.n + self.dead_zones
        return slice(0, a), slice(a, b), slice(b, b + self.creep_weights)

    @property
    def weight_names(self) -> tuple[str, ...]:
        """Names of the unknowns, in order."""
        return (
            *(f"w_H{i}" for i in range(1, self.n + 1)),
            *(f"w'_S{i - self.middle}" for i in range(self.dead_zones)),
            *(f"w_K{i}" for i in range(self.creep_weights)),
            *(("offset",) if self.offset else ()),
        )

    @cached_property
    def slope_map(self) -> Matrix:
        """The bijection T from slope to weight coordinates, w = T v, shape (d, d)."""
        return read_only(np.linalg.inv(self.inverse_slope_map).round() + 0.0)  # whole numbers, none of them −0

    @cached_property
    def inverse_slope_map(self) -> Matrix:
        """The partial sums T⁻¹ from weight to slope coordinates, v = T⁻¹ w, shape (d, d), of zeros and ones."""
        return read_only(np.column_stack([self.slopes_of(unit) for unit in np.eye(self.d)]))

    def slopes_of(self, w: Vector) -> Vector:
        """v (d,) of w (d,), to the last bit as in the core: summed outwards from zero."""
        v, middle = w.copy(), self.middle
        S = v[self.slices[1]]
        S[middle:], S[: middle + 1] = np.cumsum(S[middle:]), np.cumsum(S[middle::-1])[::-1]
        return v

    def lower_bounds(self, min_slope: float) -> Vector:
        """Lower bounds of v: 0 for w_H and w_K, ``min_slope`` (normalised units) for slopes, −∞ for the offset."""
        lb = np.zeros(self.d)
        lb[self.slices[1]] = min_slope
        if self.offset:
            lb[-1] = -np.inf
        return lb

    @cached_property
    def straight_line(self) -> Vector:
        """Weights of the line from the input range to the output range, the prior without data."""
        w = np.zeros(self.d)
        w[self.n + self.middle] = 1.0
        return read_only(w)

    def unit_input(self, x: Vector) -> Vector:
        """Input in normalised units."""
        return (x - self.x_centre) / self.x_scale

    def unit_output(self, y: Vector) -> Vector:
        """Output in normalised units."""
        return (y - self.y_centre) / self.y_scale


def _centre_and_scale(span: tuple[float, float]) -> tuple[float, float]:
    low, high = map(float, span)
    return 0.5 * (low + high), 0.5 * (high - low)
