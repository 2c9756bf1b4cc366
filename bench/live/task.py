"""What a live run is to do, and the model that it begins with."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bench.live.device import Declared, DeviceError, DeviceFile, Simulated
from bench.live.reference import Reference
from piezo_model import HysteresisCreepModel, ModelError, ModelStructure, json_file
from piezo_model.deployment import Deployment

Learn = Literal["continuous", "cyclic", "off"]
N, M = 5, 3
"""Orders of a model that is learned from nothing."""
SECONDS_A_RATE = (0.1, 1.0, 10.0)
"""1 over its creep rates, s."""


@dataclass(frozen=True)
class Task:
    """What a loop is to do; it can be sent to its process."""

    device: DeviceFile | Simulated
    declared: Declared
    model: HysteresisCreepModel
    identified: bool
    """Whether the model is that of a file, and not the straight line through the ranges."""
    learn: Learn
    integral_gain: float
    reference: Reference
    rate: float
    seconds: float


def first_model(file: Path | None, declared: Declared, sample_time: float) -> HysteresisCreepModel:
    """The model of a file of ``identify`` or ``deploy``, without one the straight line through the ranges.

    DeviceError where it is not of this stage, ModelError where the file holds none.
    """
    if file is None:
        structure = ModelStructure.equidistant(
            N,
            M,
            declared.x_limits,
            declared.y_range,
            tuple(1.0 / s for s in SECONDS_A_RATE),
            sample_time,
            input_unit=declared.input_unit,
            output_unit=declared.output_unit,
        )
        return HysteresisCreepModel.from_weights(structure, structure.straight_line)
    deployed = json_file.format_of(file) == Deployment.FORMAT
    model = Deployment.load(file).model if deployed else HysteresisCreepModel.load(file)
    s = model.structure
    if abs(s.sample_time / sample_time - 1.0) > 1e-6:
        raise ModelError(f"{file}: is of a model at {1.0 / s.sample_time:g} Hz; say --rate {1.0 / s.sample_time:g}")
    for what, own, other in (
        ("input", s.input_unit, declared.input_unit),
        ("output", s.output_unit, declared.output_unit),
    ):
        if own and other and own != other:
            raise DeviceError(f"{file}: has its {what} in {own} and the stage in {other}")
    return model
