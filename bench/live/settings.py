"""Settings of a live run: its stage, its first model, and its reference, which is a sine in words, a file or a set
point."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.deploy.deployment import open_model
from bench.live.device import Declared, LiveError
from piezo_model import (
    Compensator,
    HysteresisCreepModel,
    ModelStructure,
    SelfLearningCompensator,
    checks,
    recordings,
)
from piezo_model.model import ModelError
from piezo_model.units import conversion, quantity, shown
from solvers.arrays import Matrix, Vector

Learn = Literal["continuous", "cyclic", "off"]
SWEPT, BEYOND = 1_000, 0.01
"""Samples of the sweep through the drives, and largest excess over the outputs that it reaches, as a share of
them, that is not mentioned: creep reaches a little further."""
MOST_SAMPLES, LEAST_PHASE = 100_000, 1e-7
"""Most samples of a sine before it repeats, unless one period is longer, and least share of a period in a sample."""


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a run, which can be sent to its processes."""

    make: Callable[[], Any]
    """Makes the stage, not yet open."""
    name: str
    """Of the stage."""
    declared: Declared
    model: HysteresisCreepModel
    identified: bool
    """Whether the model is from a file, rather than the straight line through the ranges."""
    learn: Learn
    integral_gain: float
    reference: Vector
    """Samples in the output unit, repeated. Shape (N,)."""
    words: str
    """Description of the reference."""
    rate: float
    seconds: float
    command: int = field(default_factory=os.getpid)
    """Process that starts, watches and records the run."""

    @property
    def limit_s(self) -> float:
        """Longest time from a sample to the next, and longest silence of the sensor: samples are a period apart."""
        return self.declared.timeout_s + 1.0 / self.rate

    def compensator(self) -> Compensator | SelfLearningCompensator:
        """The compensator, with its actuator at rest; LiveError if no compensator can have these settings."""
        options: dict[str, Any] = {
            "x_limits": self.declared.x_limits,
            "rate_limit": self.declared.rate_limit,
            "x_start": self.declared.rest,
            "integral_gain": self.integral_gain,
        }
        with checks.refusing(LiveError, f"{self.name}: "):
            if self.learn == "off":
                return Compensator(self.model, **options)
            return SelfLearningCompensator(
                self.model.structure,
                mode=self.learn,
                solver="box_active_set",
                model=self.model if self.identified else None,
                **options,
            )

    def tracking(self, samples: Matrix, last: int) -> tuple[Vector, str]:
        """The errors of the last of these samples of a board against the reference, late by the lag, and their RMS in a
        sentence, which is empty if nothing was measured."""
        k = np.arange(len(samples))
        late = np.interp(k - self.model.lag_s * self.rate, k, samples[:, 1]) if k.size else samples[:, 1]
        errors = (samples[:, 3] - late)[-last:]
        known = errors[np.isfinite(errors)]
        if not known.size:
            return errors, ""
        rms = quantity(math.sqrt(np.mean(known**2)), self.declared.output_unit, 3)
        after_lag = " after the lag" * (self.model.lag_s > 0.0)
        return errors, f"Tracking error{after_lag} over the last {errors.size / self.rate:.3g} s: {rms} RMS."

    def out_of_reach(self) -> str:
        """A sentence if the stage cannot follow the reference by its first model, in the range of that; empty if it
        can."""
        low, high = np.clip(self.declared.x_limits, *self.model.structure.x_range).tolist()
        up, y_ref = np.linspace(low, high, SWEPT), self.reference
        y = self.model.static.simulate(np.concatenate([up, up[::-1]]))
        if max(y.min() - y_ref.min(), y_ref.max() - y.max()) <= BEYOND * np.ptp(y):
            return ""
        ends = [quantity(float(end), self.declared.output_unit, 3) for x in (y_ref, y) for end in (x.min(), x.max())]
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
            n=5,
            m=3,
            x_range=declared.x_limits,
            y_range=declared.y_range,
            creep_rates=(10.0, 1.0, 0.1),
            sample_time=sample_time,
            input_unit=declared.input_unit,
            output_unit=declared.output_unit,
        )
        return HysteresisCreepModel.from_weights(structure, structure.straight_line)
    model = open_model(file)[0]
    with checks.refusing(ModelError, f"{file}: "):
        model = (model if dynamics else model.static).at(sample_time)
    return replace(model, structure=model.structure.in_units(declared.input_unit, declared.output_unit, str(file)))


def set_point(value: float | str, unit: str, y_range: tuple[float, float], sample_time: float) -> tuple[Vector, str]:
    """One output within the range."""
    low, high = sorted(y_range)
    with checks.refusing(LiveError):
        within = f"a number from {low:g} to {high:g} {shown(unit)}"
        checks.require(lambda y: low <= float(y) <= high, within, **{"the set point": value})
    return np.array([float(value)]), f"set point {quantity(float(value), unit)}"


def sine(text: str, unit: str, y_range: tuple[float, float], sample_time: float) -> tuple[Vector, str]:
    """A sine from words such as ``5Hz:10um`` or ``5Hz:10um:2um``: frequency, amplitude, and centre, which is the middle
    of the range by default.

    Examples
    --------
    >>> sine("1Hz:0.01mm", "um", (0.0, 6.0), 0.25)[0].round(9).tolist()
    [3.0, 13.0, 3.0, -7.0]
    """
    try:
        frequency, amplitude, *more = (_value(word, unit if k else "Hz") for k, word in enumerate(text.split(":")))
        (centre,) = more or [0.5 * sum(y_range)]
        checks.finite(amplitude=amplitude, centre=centre)
    except ValueError:
        raise LiveError(
            f"--sine {text}: must be a frequency in Hz and an amplitude in {shown(unit)}, such as 5Hz:10um, and "
            "optionally a centre"
        ) from None
    phase = frequency * sample_time
    checks.check(
        LEAST_PHASE <= phase < 0.5,
        f"--sine {text}: the frequency must be at least {LEAST_PHASE / sample_time:g} Hz and below half the "
        f"sampling rate, {0.5 / sample_time:g} Hz",
        LiveError,
    )
    # a number of whole periods that takes a whole number of samples
    repeats = Fraction(1.0 / phase).limit_denominator(max(1, round(MOST_SAMPLES * phase)))
    phases = np.arange(repeats.numerator) * repeats.denominator % repeats.numerator / repeats.numerator
    return centre + amplitude * np.sin(2.0 * math.pi * phases), f"sine {text}"


def _value(text: str, unit: str) -> float:
    """The value in this unit of a number, which may have a unit of its own; ValueError for anything else."""
    own = text.lstrip("+-.0123456789e")
    return float(text.removesuffix(own)) * conversion("", "value", own or unit, unit)[0]


def of_file(path: Path, unit: str, y_range: tuple[float, float], sample_time: float) -> tuple[Vector, str]:
    """The reference column of a file, in the unit and of the sampling time of the stage."""
    reference = recordings.read_reference(path).suited(unit)
    checks.check(
        abs(reference.sample_time / sample_time - 1.0) <= 0.01,
        f"{path}: is sampled every {reference.sample_time:g} s, expected every {sample_time:g} s; "
        f"use --rate {1.0 / reference.sample_time:g}",
        LiveError,
    )
    return reference.values, reference.units.rstrip(".") or path.name


REFERENCES: Mapping[str, Callable[..., tuple[Vector, str]]] = {
    "--reference": of_file,
    "--sine": sine,
    "--set-point": set_point,
}
"""By option, the function of its value, unit and range of the output, and sampling time that returns the samples of a
reference and their description."""
