"""Settings of a live run, and its first model."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from bench.live.device import Declared, DeviceFile, Simulated
from bench.live.reference import Reference
from piezo_model import HysteresisCreepModel, ModelStructure, checks
from piezo_model.deployment import open_model
from piezo_model.model import ModelError
from piezo_model.units import quantity

Learn = Literal["continuous", "cyclic", "off"]
N, M = 5, 3
"""Orders of the model that a run without a file learns."""
CREEP_TIMES_S = (0.1, 1.0, 10.0)
"""Reciprocals of its creep rates."""
SWEPT, BEYOND = 1_000, 0.01
"""Samples of the sweep through the drive's limits, and largest excess over the outputs that it reaches, as a share of
them, that is not mentioned: creep reaches a little further."""


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
    model = open_model(file)[0]
    with checks.refusing(ModelError, f"{file}: "):
        model = (model if dynamics else model.static).at(sample_time)
    return replace(model, structure=model.structure.in_units(declared.input_unit, declared.output_unit, str(file)))
