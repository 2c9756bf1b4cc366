"""The interface to hardware: one file with one class.

    class Stage:
        input_unit, output_unit = "V", "um"
        x_limits, y_range = (0.0, 150.0), (-20.0, 20.0)      # limits of the drive; outputs there, about
        rate_limit, rest = 5000.0, 0.0                       # largest change of the drive per second; drive at rest
        def open(self): ...                                  # connect to the hardware, whose drive is at rest
        def exchange(self, x): ...                           # write the drive, return the output, NaN if missing
        def close(self): ...                                 # release the hardware

Optional are ``timeout_s``, the longest exchange before the stage counts as lost (0.5 s), and ``reopens``, whether a
second process may open the stage after the first has died (True), to bring it to rest. The process of the stage has a
timer, which ends it after that time, so a stage must not use SIGALRM.
"""

import inspect
import runpy
import time
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec

from piezo_model import checks, json_file, plants

METHODS = ("open", "exchange", "close")
RAMP_S = 0.01
"""Shortest time in which a simulated stage may cross its range."""
MAX_CATCH_UP = 1_000
"""Most samples that a simulated stage makes up for after a pause."""


class LiveError(ValueError):
    """A stage, reference or page that no run can have; the message is one sentence."""


class Declared(msgspec.Struct, frozen=True):
    """Attributes that a stage declares; model and compensator refuse ranges that cannot be."""

    input_unit: str
    output_unit: str
    x_limits: tuple[json_file.Number, json_file.Number]
    y_range: tuple[json_file.Number, json_file.Number]
    rate_limit: Annotated[float, msgspec.Meta(gt=0.0, le=json_file.LARGEST)]
    rest: json_file.Number
    timeout_s: Annotated[float, msgspec.Meta(ge=1e-3, le=3600.0)] = 0.5
    reopens: bool = True

    @classmethod
    def of(cls, stage: Any, name: str) -> Self:
        """Check the attributes of a stage; LiveError names a missing or wrong one."""
        attributes = {field: getattr(stage, field) for field in cls.__struct_fields__ if hasattr(stage, field)}
        with checks.refusing(LiveError, f"{name}: the class {type(stage).__name__}: "):
            return json_file.convert(attributes, cls)


def stage_of(path: Path) -> Any:
    """The stage of a user's file, not yet open; LiveError if the file does not define exactly one."""
    try:
        stages = [
            value()
            for value in runpy.run_path(str(path), run_name="stage").values()
            if inspect.isclass(value)
            and value.__module__ == "stage"
            and all(callable(getattr(value, method, None)) for method in METHODS)
        ]
    except Exception as error:
        raise LiveError(f"{path}: cannot be run: {type(error).__name__}: {error}") from None
    checks.check(
        len(stages) == 1,
        f"{path}: must define one class with the methods {', '.join(METHODS)}, and defines {len(stages)}",
        LiveError,
    )
    return stages[0]


class SimulatedStage:
    """A simulated actuator with a sensor in real time: between two exchanges it holds the drive of the first, as
    hardware does.

    The sensor's noise has this standard deviation, µm. LiveError if there is no such actuator.
    """

    input_unit, output_unit = "V", "um"
    reopens = False

    def __init__(self, kind: str, sample_time: float, noise_um: float = 0.002) -> None:
        known = (*plants.names(), *plants.STAGES)
        checks.check(kind in known, f"there is no simulated actuator {kind!r}; known are {', '.join(known)}", LiveError)
        with checks.refusing(LiveError, f"simulated {kind}: "):
            self._plant = plants.Sensor(plants.stage(kind, sample_time), noise_um=noise_um)
        self.x_limits, self.y_range, self.rest = self._plant.x_range, self._plant.y_range, self._plant.x_range[0]
        self.rate_limit = (self.x_limits[1] - self.x_limits[0]) / RAMP_S
        self._started, self._sample_time, self._x, self._samples = time.perf_counter(), sample_time, self.rest, 0

    def open(self) -> None:
        """Do nothing."""

    def exchange(self, x: float) -> float:
        """Advance the plant by the samples that are due, at least one, and return its output."""
        due = round((time.perf_counter() - self._started) / self._sample_time)
        for _ in range(min(due - self._samples, MAX_CATCH_UP)):
            self._plant.step(self._x)
        self._samples, self._x = max(due, self._samples) + 1, x
        return self._plant.step(x)

    def close(self) -> None:
        """Do nothing."""
