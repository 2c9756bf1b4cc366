"""The interface to hardware: one file with one class.

    class Stage:
        input_unit, output_unit = "V", "um"
        x_limits, y_range = (0.0, 150.0), (-20.0, 20.0)      # limits of the drive; outputs there, about
        rate_limit, rest = 5000.0, 0.0                       # largest change of the drive per second; drive at rest
        def open(self): ...
        def exchange(self, x): ...                           # write the drive, return the measured output
        def close(self): ...

Optional are ``timeout_s``, the longest exchange before the stage counts as lost (0.5 s), and ``reopens``, whether a
second process may open the stage after the first has died (True), to bring it to rest. The process of the stage has a
timer, which ends it after that time, so a stage must not use SIGALRM.
"""

from __future__ import annotations

import inspect
import math
import runpy
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, cast

import msgspec

from piezo_model import checks, json_file, plants

METHODS = ("open", "exchange", "close")
LARGEST = 1e300
Finite = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
RAMP_S = 0.01
"""Shortest time in which a simulated stage may cross its range."""
MAX_CATCH_UP = 1_000
"""Most samples that a simulated stage makes up for after a pause."""


class DeviceError(ValueError):
    """A stage that cannot be used; the message is one sentence."""


class Device(Protocol):
    """Methods of a stage; its attributes are checked by :meth:`Declared.of`."""

    def open(self) -> None:
        """Connect to the hardware, whose drive is at rest."""

    def exchange(self, x: float) -> float:
        """Write the drive (input unit) and return the measured output (output unit), NaN if missing."""

    def close(self) -> None:
        """Release the hardware."""


class Declared(msgspec.Struct, frozen=True):
    """Attributes that a stage declares."""

    input_unit: str
    output_unit: str
    x_limits: tuple[Finite, Finite]
    y_range: tuple[Finite, Finite]
    rate_limit: Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST)]
    rest: Finite
    timeout_s: Annotated[float, msgspec.Meta(ge=1e-3, le=3600.0)] = 0.5
    reopens: bool = True

    @classmethod
    def of(cls, device: Any, name: str) -> Declared:
        """Check the attributes of a stage; DeviceError names a missing or wrong one."""
        attributes = {field: getattr(device, field) for field in cls.__struct_fields__ if hasattr(device, field)}
        try:
            declared = json_file.convert(attributes, cls)
        except ValueError as error:
            raise DeviceError(f"{name}: the class {type(device).__name__}: {json_file.brief(error)}") from None
        if not declared.x_limits[0] < declared.x_limits[1]:
            raise DeviceError(f"{name}: x_limits must be in ascending order, not {declared.x_limits}")
        if declared.y_range[0] == declared.y_range[1]:
            raise DeviceError(f"{name}: y_range must be two different outputs, not {declared.y_range}")
        if not declared.x_limits[0] <= declared.rest <= declared.x_limits[1]:
            raise DeviceError(f"{name}: rest {declared.rest:g} is outside of x_limits {declared.x_limits}")
        return declared


@dataclass(frozen=True)
class DeviceFile:
    """A stage defined in a user's file; each process makes its own instance."""

    path: Path

    def make(self) -> Device:
        """Make the stage, not yet open; DeviceError if the file does not define exactly one."""
        try:
            stages: list[Any] = [
                value()
                for value in runpy.run_path(str(self.path), run_name="stage").values()
                if inspect.isclass(value)
                and value.__module__ == "stage"
                and all(callable(getattr(value, method, None)) for method in METHODS)
            ]
        except OSError as error:
            raise DeviceError(f"{self.path}: {error.strerror}") from None
        except Exception as error:
            raise DeviceError(f"{self.path}: cannot be run: {type(error).__name__}: {error}") from None
        if len(stages) != 1:
            raise DeviceError(
                f"{self.path}: holds {len(stages)} classes with the methods {', '.join(METHODS)}, and one is needed"
            )
        return cast(Device, stages[0])

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class Simulated:
    """A simulated actuator with a sensor, which lives in the process of the loop."""

    kind: str
    sample_time: float
    seed: int = 0
    noise: float = 0.002
    """Standard deviation of the sensor's noise, output units."""

    def make(self) -> Device:
        """Make the stage; DeviceError if there is no such plant."""
        known = (*plants.names(), *plants.STAGES)
        if self.kind not in known:
            raise DeviceError(f"there is no simulated actuator {self.kind!r}; known are {', '.join(known)}")
        with checks.refusing(DeviceError, f"simulated {self.kind}: "):
            plant = plants.stage(self.kind, self.sample_time)
        return SimulatedStage(plants.Sensor(plant, noise_um=self.noise, seed=self.seed), self.sample_time)

    def __str__(self) -> str:
        return f"simulated {self.kind}"


class SimulatedStage:
    """A plant in real time: between two exchanges it holds the drive of the first, as hardware does."""

    input_unit, output_unit = "V", "um"
    reopens = False

    def __init__(self, plant: plants.Plant, sample_time: float) -> None:
        self._plant, self._sample_time = plant, sample_time
        self.x_limits, self.y_range = plant.x_range, plant.y_range
        self.rest = self.x_limits[0]
        self.rate_limit = (self.x_limits[1] - self.x_limits[0]) / RAMP_S
        self._x, self._samples, self._started = self.rest, 0, math.nan

    def open(self) -> None:
        """Do nothing."""

    def exchange(self, x: float) -> float:
        """Advance the plant by the samples that are due, at least one, and return its output."""
        now = time.perf_counter()
        if not self._samples:
            self._started = now
        due = round((now - self._started) / self._sample_time)
        for _ in range(min(due - self._samples, MAX_CATCH_UP)):
            self._plant.step(self._x)
        self._samples, self._x = max(due, self._samples) + 1, x
        return self._plant.step(x)

    def close(self) -> None:
        """Do nothing."""
