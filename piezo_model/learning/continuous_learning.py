"""Continuous operation, the paper's outlook: the data basis is updated, and the weights with it, in real time.

What is done with each sample stands in `continuous_step`; here is what a fault of the sensor brings. Nothing learned before
a fault is lost, and nothing learned from a sensor about to fail is kept:

- at a fault solver and weights go back to a state noted at least one checkpoint ago, and learning waits until samples have
  been good for ``reset_s``;
- if the weights in use predicted these samples about as well as before the fault, it goes on from there;
- otherwise sensor or actuator are not what they were: learning begins anew, and new weights are handed over once they have
  learned for ``memory_s`` without another fault. The noted state is kept until then, since a sensor that was gone may come back.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem

from piezo_model.compensator import DECAY, Compensator
from piezo_model.learning import continuous_step as step
from piezo_model.learning.continuous_step import ContinuousArrays
from piezo_model.learning.cyclic_learning import MIN_EXCITATION
from piezo_model.learning.driven_range import PIECE_S, DrivenRange, carried_over
from piezo_model.learning.events import (
    CHECKPOINT,
    FAILED,
    FAULT,
    FIRST_HAND_OVER,
    LEARN,
    NONE,
    PHASES,
    RESET,
    Event,
    Log,
    Phase,
)
from piezo_model.learning.sensor_guard import fresh_memory
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import RegressorArrays
from piezo_model.structure import ModelStructure
from solvers.core import padded
from solvers.kernels.recursive_engine import RecursiveEngine

Vector = NDArray[np.float64]
Snapshot = dict[str, NDArray[Any]]

BELIEF = 1e-6
"""What the weights in use count where learning begins anew, as a share of a full memory of unit amplitudes."""
PROXIMAL = 1e-8
"""Share of the mean diagonal with which the solver holds what the data leave open where it is."""
TRUST, TOLERANCE = 5.0, 2e-3
"""After a fault the sensor is the old one if the RMS error of the weights in use is at most TRUST times what it was before,
plus TOLERANCE unit amplitudes."""
CHECKPOINT_S = 0.5
SNAPSHOT = ("work", "iwork", "solver_numbers")
MEMORY = ("play", "creep", "guard", "counts", "numbers", "in_use", "candidate", *SNAPSHOT)


def prior(s: ModelStructure, w: Vector) -> Problem:
    """What learning begins with: weights w (d,), in slope coordinates, with the weight of BELIEF."""
    lb = s.lower_bounds(MIN_SLOPE)
    return Problem(BELIEF * np.eye(s.d), -BELIEF * np.maximum(s.inverse_slope_map @ w, lb), lb=lb, ub=np.full(s.d, np.inf))


class ContinuousLearning:
    """The continuous learner of a compensator.

    Parameters
    ----------
    compensator : Compensator
        Whose weights it changes.
    settings : LearningSettings
    log : deque of Event
        Gets what changes how learning goes on; hand-overs and refusals are counted, and only the first is an event.
    """

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log) -> None:
        s = compensator.model.structure
        self._compensator, self._log, self._settings = compensator, log, settings
        self._driven = DrivenRange(round(PIECE_S / CHECKPOINT_S))
        self._checkpoints: deque[Snapshot] = deque(maxlen=2)
        self._fallback: Snapshot | None = None
        state, regressors = compensator.state.copy(), RegressorArrays.of(s, "slope")

        def samples(seconds: float) -> int:
            return max(1, round(seconds / s.sample_time))

        self._engine = RecursiveEngine(forgetting=math.exp(-s.sample_time / settings.memory_s), proximal=PROXIMAL)
        self._engine.setup(prior(s, compensator.model.weights))
        size, interval = padded(regressors.width), samples(settings.hand_over_s)
        self.arrays = ContinuousArrays(
            regressors, compensator.limits, state.play, state.creep, np.zeros(regressors.stride + 8), fresh_memory(),
            np.zeros(step.COUNTS, dtype=np.int64), np.zeros(step.NUMBERS), np.zeros(size), np.zeros(size),
            np.zeros_like(compensator.inverse.weights), s.middle, self._engine._work, self._engine._iwork, self._engine._numbers)
        counts, numbers = self.arrays.counts, self.arrays.numbers
        counts[step.RESET_LASTS] = counts[step.LEFT] = samples(settings.reset_s)
        counts[step.INTERVAL], counts[step.CHECKPOINTS] = interval, interval * max(1, samples(CHECKPOINT_S) // interval)
        counts[step.HALF_WINDOW] = samples(settings.memory_s)
        numbers[step.SMOOTHING] = 1.0 / samples(1.0)
        numbers[step.EXCITATION] = 2.0 * MIN_EXCITATION
        compensator.fade[DECAY] = math.exp(-s.sample_time / settings.fade_s)
        self.arrays.numbers[step.X_LOW:step.Y_HIGH + 1] = math.inf, -math.inf, math.inf, -math.inf
        self._begin_anew(0.0)
        self._enter(RESET)

    @property
    def phase(self) -> Phase:
        """``reset`` while the sensor is on probation, otherwise ``learn``."""
        return PHASES[self.arrays.counts[step.PHASE]]

    @property
    def counts(self) -> NDArray[np.int64]:
        """The counts of `continuous_step`."""
        return self.arrays.counts

    def samples_until_change(self) -> int:
        """Samples for which the weights in use cannot change."""
        interval = int(self.counts[step.INTERVAL])
        return interval - int(self.counts[step.SAMPLE]) % interval

    def _compensator_arrays(self) -> tuple[Any, ...]:
        c = self._compensator
        return c.inverse, c.state.play, c.state.creep, c.fade

    def observe(self, x: Vector, y: Vector) -> None:
        """Learn from drive samples and the outputs that they produced."""
        done = 0
        while done < x.size:
            done, signal = step.observe(self.arrays, *self._compensator_arrays(), x, y, done)
            self._follow(signal)

    def drive_and_observe(self, y_ref: Vector, y: Vector) -> Vector:
        """Drive samples (N,), each followed by learning from the output (N,) that it produced."""
        done, x = 0, np.empty_like(y_ref)
        while done < x.size:
            done, signal = step.drive_and_observe(self.arrays, *self._compensator_arrays(), y_ref, y, x, done)
            self._follow(signal)
        return x

    def _note(self, what: Any, message: str) -> None:
        self._log.append(Event(int(self.counts[step.SAMPLE]), what, message))

    def _follow(self, signal: int) -> None:
        if signal == NONE:
            return
        if signal == CHECKPOINT:
            if self.counts[step.ESTABLISHED]:
                self._checkpoints.append(self._snapshot())
            self._follow_range()
        elif signal == FIRST_HAND_OVER:
            self._note("hand-over", "the first new weights since learning began; further ones are counted only")
        elif signal == FAULT:
            self._note("sensor", "the output jumped, froze or left its range; learning waits")
            self._driven.interrupt()
            self.arrays.numbers[step.X_LOW:step.Y_HIGH + 1] = math.inf, -math.inf, math.inf, -math.inf
            self._fall_back()
            self._enter(RESET)
        elif signal == FAILED:
            self._recover()
        else:
            self._end_of_probation()

    def _follow_range(self) -> None:
        """Go on in other ranges, where those that are driven are others."""
        arrays, old = self.arrays, self._compensator.model.structure
        span = arrays.numbers[step.X_LOW:step.Y_HIGH + 1]
        new = self._driven.look(span, old) if self._settings.follow_range and np.all(np.isfinite(span)) else None
        span[:] = math.inf, -math.inf, math.inf, -math.inf
        if new is None:
            return
        self._compensator.change_model(carried_over(self._compensator.model, new), self._settings.fade_s)
        state = OperatorState(arrays.play, arrays.creep).on(old, new)
        arrays.play[:], arrays.creep[:], arrays.guard[:] = state.play, state.creep, fresh_memory()
        self.arrays = arrays._replace(limits=self._compensator.limits)
        self._fallback = None
        self._begin_anew(float(arrays.numbers[step.LEVEL]) * (old.x_scale / new.x_scale) ** 2)
        self._note("range", "the thresholds follow the range that was driven")

    def _recover(self) -> None:
        """Go on from the data so far with the cold exact solver, where they have an optimum."""
        try:
            self._engine.recover()
        except ValueError as error:
            self._note("refused", f"{error}; learning begins anew")
            self._begin_anew(float(self.arrays.numbers[step.LEVEL]))

    def _enter(self, phase: int) -> None:
        self.counts[step.PHASE], self.counts[step.LEFT] = phase, self.counts[step.RESET_LASTS]
        self.counts[step.PREDICTED] = 0
        for number in (step.PROBATION, step.OLD, step.NEW):
            self.arrays.numbers[number] = 0.0

    def _snapshot(self) -> Snapshot:
        return {"level": self.arrays.numbers[step.LEVEL:step.LEVEL + 1].copy(), "in_use": self.arrays.in_use.copy(),
                **{name: getattr(self.arrays, name).copy() for name in SNAPSHOT}}

    def _fall_back(self) -> None:
        """Go back to a state that the sensor was good at, if there is one."""
        if self._checkpoints:
            self._fallback = self._checkpoints[0]
            self._checkpoints.clear()
        if self._fallback is None:
            self._begin_anew(0.0)
            return
        for name in SNAPSHOT:
            getattr(self.arrays, name)[:] = self._fallback[name]
        self.arrays.numbers[step.LEVEL] = self._fallback["level"][0]
        self.arrays.candidate[:] = self._fallback["in_use"]
        self.counts[step.ESTABLISHED] = self.counts[step.REVERT] = 1

    def _end_of_probation(self) -> None:
        numbers = self.arrays.numbers
        error = float(numbers[step.PROBATION] / self.counts[step.RESET_LASTS])
        if self._fallback is not None and math.sqrt(error) > TRUST * math.sqrt(numbers[step.LEVEL]) + TOLERANCE:
            self._note("sensor", "the output is not what it was before the fault; learning begins anew")
            self._begin_anew(error)
        elif self._fallback is None:
            numbers[step.LEVEL] = error
        self._enter(LEARN)

    def _begin_anew(self, level: float) -> None:
        """Forget everything but the weights in use."""
        arrays, s = self.arrays, self._compensator.model.structure
        w = self._compensator.model.weights
        problem = prior(s, w)
        self._engine.update(problem.P, problem.q)
        arrays.in_use[0] = arrays.candidate[0] = 1.0
        arrays.in_use[1:s.d + 1] = arrays.candidate[1:s.d + 1] = s.inverse_slope_map @ w
        arrays.numbers[step.LEVEL], self.counts[step.ESTABLISHED], self.counts[step.REVERT] = level, 0, 0
        self._checkpoints.clear()
        self.counts[step.IN_HALF] = 0
        self.counts[step.WAIT] = 0 if self._fallback is None else self.counts[step.HALF_WINDOW]
        for low, high in ((step.LOW, step.HIGH), (step.LOW_BEFORE, step.HIGH_BEFORE)):
            arrays.numbers[low], arrays.numbers[high] = math.inf, -math.inf

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, copied."""
        return {**{name: getattr(self.arrays, name).copy() for name in MEMORY},
                "checkpoints": [dict(snapshot) for snapshot in self._checkpoints],
                "driven": self._driven.memory(), "fallback": None if self._fallback is None else dict(self._fallback)}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; the compensator has been restored before."""
        for name in MEMORY:
            if memory[name].shape != getattr(self.arrays, name).shape:
                raise ValueError(f"the array {name!r} of continuous learning is that of another structure")
        for name in MEMORY:
            getattr(self.arrays, name)[:] = memory[name]
        self.arrays = self.arrays._replace(limits=self._compensator.limits)
        self._driven.restore(memory["driven"])
        self._checkpoints.clear()
        self._checkpoints.extend(memory["checkpoints"])
        self._fallback = memory["fallback"]
