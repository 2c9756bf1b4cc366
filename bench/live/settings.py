"""Settings of a live run: its stage, its first model, and its reference, which is a sine or staircase given in words, a
file, or a set point.

sine 5Hz:10um[:2um]           frequency, amplitude, and centre (the middle of the range by default)
staircase 0.5s:4um:8          time and height of a level, and number of levels
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.live.device import Declared, DeviceFile, Simulated
from piezo_model import HysteresisCreepModel, ModelStructure, checks, deployment, recordings
from piezo_model.model import ModelError
from piezo_model.units import quantity, shown
from solvers.arrays import Vector

Learn = Literal["continuous", "cyclic", "off"]
N, M = 5, 3
"""Orders of the model that a run without a file learns."""
CREEP_TIMES_S = (0.1, 1.0, 10.0)
"""Reciprocals of its creep rates."""
SWEPT, BEYOND = 1_000, 0.01
"""Samples of the sweep through the drive's limits, and largest excess over the outputs that it reaches, as a share of
them, that is not mentioned: creep reaches a little further."""
MOST_SAMPLES = 100_000
"""Most samples of a sine before it repeats, unless one period is longer."""


class ReferenceError(ValueError):
    """A reference that cannot be followed; the message is one sentence."""


@dataclass(frozen=True)
class Reference:
    """A sequence of samples, repeated."""

    samples: Vector
    """Shape (N,), output unit."""
    words: str

    def at(self, k: int) -> float:
        """Sample k."""
        return float(self.samples[k % self.samples.size])


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a run, which can be sent to the process of the loop."""

    device: DeviceFile | Simulated
    declared: Declared
    model: HysteresisCreepModel
    identified: bool
    """Whether the model is from a file, rather than the straight line through the ranges."""
    learn: Learn
    integral_gain: float
    reference: Reference
    rate: float
    seconds: float

    @property
    def limit_s(self) -> float:
        """Longest time from a sample to the next, and longest silence of the sensor: samples are a period apart."""
        return self.declared.timeout_s + 1.0 / self.rate

    @property
    def lag_s(self) -> float:
        """Time by which the output lags a slow reference, since the dynamics of the first model are inverted."""
        return 0.0 if self.model.dynamics is None else self.model.dynamics.lag_s(1.0 / self.rate)

    @property
    def after_lag(self) -> str:
        """What a tracking error counts after, in words."""
        return " after the lag" * (self.lag_s > 0.0)

    def late(self, reference: Vector) -> Vector:
        """The reference (N,) that the output is to follow, late by the lag."""
        k = np.arange(reference.size)
        return np.interp(k - self.lag_s * self.rate, k, reference) if k.size else reference

    def out_of_reach(self) -> str:
        """What of the reference the stage cannot follow by its first model, in a sentence; empty if it can."""
        up, wanted = np.linspace(*self.declared.x_limits, SWEPT), self.reference.samples
        y = self.model.static.simulate(np.concatenate([up, up[::-1]]))
        low, high = y.min() - BEYOND * np.ptp(y), y.max() + BEYOND * np.ptp(y)
        if low <= wanted.min() and wanted.max() <= high:
            return ""
        ends = [quantity(float(end), self.declared.output_unit, 3) for x in (wanted, y) for end in (x.min(), x.max())]
        return "The reference goes from {} to {}, and the stage, by its model, from {} to {}.".format(*ends)


def first_model(
    file: Path | None, declared: Declared, sample_time: float, *, dynamics: bool = True
) -> HysteresisCreepModel:
    """The model in a file of ``identify`` or ``deploy``, or its static part without ``dynamics``, in the units of the
    stage and at this sampling time; without a file, the straight line through the ranges.

    UnitError if its units measure something else; ModelError if the sampling time is too long for its dynamics.
    """
    if file is None:
        structure = ModelStructure.equidistant(
            N,
            M,
            declared.x_limits,
            declared.y_range,
            tuple(1.0 / time for time in CREEP_TIMES_S),
            sample_time,
            input_unit=declared.input_unit,
            output_unit=declared.output_unit,
        )
        return HysteresisCreepModel.from_weights(structure, structure.straight_line)
    model = deployment.open_model(file)[0]
    with checks.refusing(ModelError, f"{file}: "):
        model = (model if dynamics else model.static).at(sample_time)
    return replace(model, structure=model.structure.in_units(declared.input_unit, declared.output_unit, str(file)))


def set_point(value: float, unit: str, y_range: tuple[float, float], sample_time: float) -> Reference:
    """One output within the range."""
    if not min(y_range) <= value <= max(y_range):
        raise ReferenceError(
            f"--set-point {value:g} is outside of the stage's range, {min(y_range):g} to {max(y_range):g} {unit}"
        )
    return Reference(np.array([value]), f"set point {quantity(value, unit)}")


def sine(text: str, unit: str, y_range: tuple[float, float], sample_time: float) -> Reference:
    """A sine from words such as ``5Hz:10um``.

    Examples
    --------
    >>> sine("1Hz:0.01mm", "um", (0.0, 6.0), 0.25).samples.round(9).tolist()
    [3.0, 13.0, 3.0, -7.0]
    """
    frequency, amplitude, *more = _quantities("--sine", text, ("Hz", unit, unit), 2)
    if not 0.0 < frequency < 0.5 / sample_time:
        raise ReferenceError(
            f"--sine {text}: the frequency must be positive and below half the sampling rate, {0.5 / sample_time:g} Hz"
        )
    phase = frequency * sample_time
    # a number of whole periods that takes a whole number of samples
    repeats = Fraction(1.0 / phase).limit_denominator(max(1, round(MOST_SAMPLES * phase)))
    phases = np.arange(repeats.numerator) * repeats.denominator % repeats.numerator / repeats.numerator
    centre = more[0] if more else 0.5 * sum(y_range)
    return Reference(centre + amplitude * np.sin(2.0 * math.pi * phases), f"sine {text}")


def staircase(text: str, unit: str, y_range: tuple[float, float], sample_time: float) -> Reference:
    """Levels up and down again from words such as ``0.5s:4um:8``.

    Examples
    --------
    >>> staircase("1s:2um:3", "um", (-5.0, 5.0), 1.0).samples.tolist()
    [-2.0, 0.0, 2.0, 0.0]
    """
    hold, height, count = _quantities("--staircase", text, ("s", unit, ""), 3)
    held, levels = round(hold / sample_time), round(count)
    if held < 1 or levels < 2:
        raise ReferenceError(f"--staircase {text}: needs at least two levels, each held for a sample or longer")
    steps = np.array([*range(levels), *range(levels - 2, 0, -1)]) - 0.5 * (levels - 1)
    return Reference(np.repeat(0.5 * sum(y_range) + height * steps, held), f"staircase {text}")


def of_file(path: Path, unit: str, y_range: tuple[float, float], sample_time: float) -> Reference:
    """The reference column of a file, in the unit and of the sampling time of the stage."""
    found = recordings.read_reference(path).suited(unit)
    if abs(found.sample_time / sample_time - 1.0) > 0.01:
        raise ReferenceError(
            f"{path}: is sampled every {found.sample_time:g} s, and every {sample_time:g} s is needed; "
            f"use --rate {1.0 / found.sample_time:g}"
        )
    return Reference(found.values, found.units.rstrip(".") or path.name)


REFERENCES: Mapping[str, Callable[..., Reference]] = {
    "--reference": of_file,
    "--sine": sine,
    "--staircase": staircase,
    "--set-point": set_point,
}
"""What makes a reference of an option's value, the unit and the range of the output, and the sampling time."""


def _quantities(option: str, text: str, units: tuple[str, ...], fewest: int) -> list[float]:
    """Values in these units of the parts between colons; a number without a unit is in its unit."""
    parts = text.split(":")
    if not fewest <= len(parts) <= len(units):
        raise ReferenceError(f"{option} {text}: {fewest} parts between colons are needed")
    import pint  # which takes long, and the processes of a run do not need

    registry: Any = pint.UnitRegistry()
    values = []
    for part, unit in zip(parts, units, strict=False):
        try:
            value = registry.Quantity(part)
            values.append(
                float(value.magnitude if value.dimensionless else value.to(unit or "dimensionless").magnitude)
            )
            if not math.isfinite(values[-1]):
                raise ValueError
        except (pint.errors.PintError, ValueError, TypeError, AttributeError, AssertionError):
            raise ReferenceError(
                f"{option} {text}: {part!r} is not a number{f' in {shown(unit)}' if unit else ''}"
            ) from None
    return values
