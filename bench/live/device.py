"""The interface to hardware: one file with one class.

    class Stage:
        input_unit, output_unit = "V", "um"
        x_limits, y_range = (0.0, 150.0), (-20.0, 20.0)      # of the drive, and what the output can reach
        rate_limit, rest = 5000.0, 0.0                       # largest change of the drive per second; where it rests
        def open(self): ...
        def exchange(self, x): ...                           # write the drive, return what was measured
        def close(self): ...

Optional are ``timeout_s``, how long an exchange may take before the stage is taken for lost (0.5 s), and ``reopens``,
whether a second process may open the stage after the first has died (True), which is what brings it to rest then.
"""

from __future__ import annotations

import inspect
import math
import runpy
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol

import msgspec

from piezo_model import json_file, plants

METHODS = ("open", "exchange", "close")
TIMEOUT_S = 0.5
LARGEST = 1e300
Finite = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST)]
RAMP_S = 0.01
"""Of the fastest ramp over the whole range of a simulated stage."""
MOST_AT_ONCE = 1_000
"""Samples that a simulated stage catches up with after a pause."""


class DeviceError(ValueError):
    """A stage that cannot be used; the message is one sentence."""


class Device(Protocol):
    """What a stage has; what it declares besides is checked by :meth:`Declared.of`."""

    def open(self) -> None:
        """Get ready; the drive is at rest."""

    def exchange(self, x: float) -> float:
        """Write the drive (input unit) and return what was measured (output unit), NaN where nothing was."""

    def close(self) -> None:
        """Let go of the hardware."""


class Declared(msgspec.Struct, frozen=True):
    """What a stage says of itself."""

    input_unit: str
    output_unit: str
    x_limits: tuple[Finite, Finite]
    y_range: tuple[Finite, Finite]
    rate_limit: Positive
    rest: Finite
    timeout_s: Positive = TIMEOUT_S
    reopens: bool = True

    @classmethod
    def of(cls, device: Any, name: str) -> Declared:
        """Check what a stage declares; DeviceError names what is missing or wrong."""
        said = {field: getattr(device, field) for field in cls.__struct_fields__ if hasattr(device, field)}
        try:
            found = json_file.convert(said, cls)
        except ValueError as error:
            raise DeviceError(f"{name}: the class {type(device).__name__}: {json_file.brief(error)}") from None
        for what, (low, high) in (("x_limits", found.x_limits), ("y_range", found.y_range)):
            if not low < high:
                raise DeviceError(f"{name}: {what} must be in ascending order, not {(low, high)}")
        if not found.x_limits[0] <= found.rest <= found.x_limits[1]:
            raise DeviceError(f"{name}: rest {found.rest:g} is outside of x_limits {found.x_limits}")
        return found


@dataclass(frozen=True)
class DeviceFile:
    """The stage of a user's file; each process makes its own."""

    path: Path

    def make(self) -> Device:
        """The stage, not opened yet; DeviceError where the file holds none."""
        try:
            names = runpy.run_path(str(self.path), run_name="stage")
        except OSError as error:
            raise DeviceError(f"{self.path}: {error.strerror}") from None
        except Exception as error:
            raise DeviceError(f"{self.path}: cannot be run: {type(error).__name__}: {error}") from None
        found = [
            value
            for value in names.values()
            if inspect.isclass(value)
            and value.__module__ == "stage"
            and all(callable(getattr(value, method, None)) for method in METHODS)
        ]
        if len(found) != 1:
            raise DeviceError(
                f"{self.path}: holds {len(found)} classes with the methods {', '.join(METHODS)}, and one is needed"
            )
        try:
            made: Any = found[0]()
        except Exception as error:
            raise DeviceError(f"{self.path}: {found[0].__name__}() failed: {type(error).__name__}: {error}") from None
        device: Device = made
        return device

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class Simulated:
    """A simulated actuator with a sensor; it lives in the process of the loop."""

    kind: str
    sample_time: float
    seed: int = 0
    noise: float = 0.002
    """Standard deviation of the sensor's noise, output units."""

    def make(self) -> Device:
        """The stage; DeviceError where there is no such plant."""
        if self.kind not in plants.names():
            raise DeviceError(f"there is no simulated actuator {self.kind!r}; known are {', '.join(plants.names())}")
        return SimulatedStage(
            plants.Sensor(plants.get(self.kind, sample_time=self.sample_time), noise_um=self.noise, seed=self.seed),
            self.sample_time,
        )

    def __str__(self) -> str:
        return f"simulated {self.kind}"


class SimulatedStage:
    """A plant as a stage, which goes on by the clock as hardware does: between two exchanges it keeps the drive of the
    first."""

    input_unit, output_unit = "V", "um"
    reopens = False

    def __init__(self, plant: plants.Plant, sample_time: float) -> None:
        self._plant, self._sample_time, self._opened, self._samples = plant, sample_time, math.nan, 0
        self.x_limits, self.y_range = plant.x_range, plant.y_range
        self.rest = self.x_limits[0]
        self.rate_limit = (self.x_limits[1] - self.x_limits[0]) / RAMP_S
        self._x = self.rest

    def open(self) -> None:
        """Nothing to open."""

    def exchange(self, x: float) -> float:
        """The samples of the plant that are due, at least one."""
        now = time.perf_counter()
        if not self._samples:
            self._opened = now
        due = round((now - self._opened) / self._sample_time)
        for _ in range(min(due - self._samples, MOST_AT_ONCE)):
            self._plant.step(self._x)
        self._samples, self._x = max(due, self._samples) + 1, x
        return self._plant.step(x)

    def close(self) -> None:
        """Nothing to close."""
