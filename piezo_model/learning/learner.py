"""What both learners have in common: a state of the core beside that of a compensator, and what the core has to tell.

Each sample is the core's business (``core/cyclic.h``, ``core/continuous.h``); it comes back to Python where there is something to
tell: an event for the log, a program for a solver, a range to look at.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, TypedDict

import numpy as np

from piezo_model.compensator import Compensator
from piezo_model.core import State
from piezo_model.json_file import convert
from piezo_model.learning.driven_range import DrivenRange, carried_over
from piezo_model.learning.events import PHASES, Brought, Event, Log, Phase
from piezo_model.learning.sensor_guard import fresh_memory
from piezo_model.learning.settings import LearningSettings
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import RegressorArrays
from solvers.arrays import Vector

Loop = Callable[..., tuple[int, int]]


class LearningMemory(TypedDict):
    """What changes while a learner runs."""

    core: np.ndarray
    driven: dict[str, Any]


class Learner(ABC):
    """The learner of a compensator, whose weights it changes.

    The subclass brings the state of the core, which it fills, and the core's loops that observe and drive.
    """

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log, core: State, observe: Loop, drive: Loop,
                 driven: DrivenRange) -> None:
        self._compensator, self._settings, self._log, self.core = compensator, settings, log, core
        self._observe, self._drive, self._driven = observe, drive, driven
        RegressorArrays.of(compensator.model.structure, "slope").write(core)
        self._take_structure(compensator.state)

    def _take_structure(self, state: OperatorState) -> None:
        """Take ranges and weights of the compensator's model, and the states of its operators."""
        model = self._compensator.model
        s, core = model.structure, self.core
        core["scales"][:] = s.x_centre, s.x_scale, s.y_centre, s.y_scale
        core["in_use"][:] = s.inverse_slope_map @ model.weights
        core["play"][:], core["creep"][:] = state.play, state.creep
        core["guard"][:] = fresh_memory()

    @property
    def phase(self) -> Phase:
        """The phase that it is in."""
        return PHASES[self.count("phase")]

    def count(self, name: str) -> int:
        """A count of ``core/learning.h`` by its name."""
        return int(self.core.whole(name)[0])

    @abstractmethod
    def samples_until_change(self) -> int:
        """Samples for which the weights in use cannot change."""

    def observe(self, x: Vector, y: Vector) -> None:
        """Learn from drive samples and the outputs that they produced."""
        done = 0
        while done < x.size:
            done, brought = self._observe(self.core.block, self._compensator.block, y, x, done)
            if brought:
                self._follow(Brought(brought))

    def drive_and_observe(self, y_ref: Vector, y: Vector) -> Vector:
        """Drive samples (N,), each followed by learning from the output (N,) that it produced."""
        done, x = 0, np.empty_like(y_ref)
        while done < x.size:
            done, brought = self._drive(self.core.block, self._compensator.block, y, y_ref, x, done)
            if brought:
                self._follow(Brought(brought))
        return x

    @abstractmethod
    def _follow(self, brought: Brought) -> None:
        """Note what a sample brought, and do what is Python's part."""

    def _note(self, what: Any, message: str, learning_since: int = 0, old: float = math.nan, new: float = math.nan) -> None:
        self._log.append(Event(self.count("sample"), what, message, old, new, learning_since))

    def _follow_range(self, span: Vector) -> bool:
        """Go on in other ranges, where those that were driven are others; the caller makes the learner begin anew."""
        old = self._compensator.model.structure
        new = self._driven.look(span, old) if self._settings.follow_range and np.all(np.isfinite(span)) else None
        if new is None:
            return False
        state = OperatorState(self.core["play"], self.core["creep"]).on(old, new)
        self._compensator.change_model(carried_over(self._compensator.model, new), self._settings.fade_s)
        self._take_structure(state)
        self._note("range", "the thresholds follow the range that was driven")
        return True

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, copied."""
        return {"core": self.core.block.copy(), "driven": self._driven.memory()}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; the compensator has been restored before."""
        found = convert(memory, LearningMemory)
        self.core.restore(found["core"])
        self._driven.restore(found["driven"])
