"""The self-learning compensator: the signal flow of the paper's Fig. 1 under a synchronous Moore machine.

Cyclic operation, each state left after its time, and outputs that depend on the state alone:

    state    lasts              what is done with each sample                      then
    reset    reset_s            the data basis is empty                            build
    build    build_s · (1 − h)  counted into the data basis                        hold
    hold     build_s · h        counted into a second one that judges the weights  learn
    learn    learn_s            one step of the solver                             reset, with the new weights if they pass

The operators follow the actuator in every state; ``reset`` clears P, q and c and never the states. A sample that the guard
refuses is not counted; a jump of the sensor sends the machine to ``reset``, and it stays there until samples are good.

Continuous operation (the paper's outlook): a forgetting data basis, the exact optimum after every sample, and a hand-over every
``hand_over_s`` of the weights that are one interval old, if they have predicted that interval at least as well as those in use.

New weights are taken over only if they are finite, admissible, and predict held-back data at least as well as the old
ones; otherwise the old ones stay. Either is an event in ``log``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model.compensator import Compensator
from piezo_model.data_basis import DataBasis
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.learning import ContinuousLearning, LearningPhase
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import OperatorState
from piezo_model.sensor_guard import SensorGuard, Verdict
from piezo_model.structure import ModelStructure

Vector = NDArray[np.float64]
Mode = Literal["cyclic", "continuous"]


class Phase(StrEnum):
    """States of the machine."""

    RESET = "reset"
    BUILD = "build"
    HOLD = "hold"
    LEARN = "learn"


FOLLOWS = {Phase.RESET: Phase.BUILD, Phase.BUILD: Phase.HOLD, Phase.HOLD: Phase.LEARN, Phase.LEARN: Phase.RESET}
"""Transitions when a state's time is over."""


@dataclass(frozen=True)
class Event:
    """Something worth knowing: a hand-over, a refusal, a fault of the sensor; times in samples."""

    sample: int
    what: Literal["hand-over", "refused", "sensor"]
    message: str
    error_old: float = float("nan")
    """RMS error (5) of the weights in use on the held-back data, unit amplitudes."""
    error_new: float = float("nan")


class SelfLearningCompensator:
    """A compensator that identifies its own model while it runs.

    Parameters
    ----------
    structure : ModelStructure
    reset_s, build_s, learn_s : float
        Lengths of the phases in s.
    solver : str
        Any registered solver; the paper's ``projected_difference`` takes one step a sample.
    x_limits : pair of float, optional
        Limits of the drive in the input unit.
    mode : "cyclic" or "continuous"
    hold_back : float
        Share of the building phase that is kept back to judge new weights with.
    memory_s : float, optional
        Time constant of forgetting in continuous mode; ``build_s`` by default.
    hand_over_s, fade_s : float
        Interval between hand-overs in continuous mode, and the time constant with which the bump of one decays.
    rate_limit : float, optional
        Largest change of the drive per second.
    model : HysteresisCreepModel, optional
        What it starts with; the straight line through the ranges by default.
    state : OperatorState, optional
        What the actuator has seen before.
    samples_to_solve : int, optional
        Samples that an exact solve takes; measured by default.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("relay_preisach", sample_time=1e-3)
    >>> structure = ModelStructure.equidistant(n=5, m=3, x_range=plant.x_range, y_range=plant.y_range,
    ...                                        creep_rates=(10.0, 1.0), sample_time=1e-3)
    >>> learner = SelfLearningCompensator(structure, reset_s=0.1, build_s=2.0, learn_s=0.1, solver="box_active_set",
    ...                                   x_limits=plant.x_range, samples_to_solve=1)
    >>> x = learner.step(0.0, float("nan"))  # nothing measured yet
    """

    def __init__(self, structure: ModelStructure, reset_s: float = 0.1, build_s: float = 8.0, learn_s: float = 1.9,
                 solver: str = "projected_difference", x_limits: tuple[float, float] | None = None,
                 mode: Mode = "cyclic", *, hold_back: float = 0.2, memory_s: float | None = None,
                 hand_over_s: float = 0.01, fade_s: float = 0.002, rate_limit: float | None = None,
                 model: HysteresisCreepModel | None = None, state: OperatorState | None = None,
                 samples_to_solve: int | None = None) -> None:
        if mode not in ("cyclic", "continuous"):
            raise ValueError(f"mode must be cyclic or continuous, not {mode!r}")
        for name, value in (("reset_s", reset_s), ("build_s", build_s), ("learn_s", learn_s),
                            ("hand_over_s", hand_over_s)):
            if not value > 0.0:
                raise ValueError(f"{name} must be positive, not {value}")
        if not 0.0 < hold_back < 1.0:
            raise ValueError(f"hold_back must be between 0 and 1, not {hold_back}")
        self.structure, self.solver, self.mode = structure, solver, mode
        start = HysteresisCreepModel.from_weights(structure, structure.straight_line) if model is None else model
        self.compensator = Compensator(start, x_limits, rate_limit, state)
        self.log: deque[Event] = deque(maxlen=1000)
        self.samples = 0
        self.fade_s = fade_s
        self._samples_to_solve = samples_to_solve
        self._lasts = {phase: max(1, round(seconds / structure.sample_time)) for phase, seconds in (
            (Phase.RESET, reset_s), (Phase.BUILD, build_s * (1.0 - hold_back)), (Phase.HOLD, build_s * hold_back),
            (Phase.LEARN, learn_s))}
        self._guard = SensorGuard()
        self._last_x: float | None = None
        self._basis = DataBasis(structure, self.compensator.state)
        self.phase, self._left = Phase.RESET, self._lasts[Phase.RESET]
        self._problem: IdentificationProblem | None = None
        self._learning: LearningPhase | None = None
        self._interval = max(1, round(hand_over_s / structure.sample_time))
        self._continuous = ContinuousLearning(structure, self.compensator.state,
                                              build_s if memory_s is None else memory_s, start.weights)
        self._candidate = start.weights
        self._errors, self._settling = np.zeros(2), self._lasts[Phase.RESET]

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        return self.compensator.model

    def step(self, y_ref: float, y_measured_before: float) -> float:
        """One sample.

        Parameters
        ----------
        y_ref : float
            Reference in the output unit.
        y_measured_before : float
            The output that the drive returned by the last call has produced; NaN where there is none.

        Returns
        -------
        float
            Drive in the input unit.
        """
        if self._last_x is not None:
            self.observe(np.array([self._last_x]), np.array([y_measured_before]))
        self._last_x = self.compensator.step(y_ref)
        return self._last_x

    def run(self, y_ref: ArrayLike, actuator: Callable[[Vector], Vector]) -> tuple[Vector, Vector]:
        """Close the loop over an actuator, a function from drive samples to output samples that remembers its state.

        The same as ``step`` sample by sample, in chunks that end where the weights may change.

        Returns
        -------
        x, y : array (N,)
            Drive and measured output.
        """
        y_ref = np.asarray(y_ref, dtype=np.float64)
        x, y = np.empty(y_ref.size), np.empty(y_ref.size)
        done = 0
        while done < y_ref.size:
            chunk = slice(done, min(done + self._left_until_change(), y_ref.size))
            x[chunk] = self.compensator.run(y_ref[chunk])
            y[chunk] = actuator(x[chunk])
            self.observe(x[chunk], y[chunk])
            done = chunk.stop
        return x, y

    def _left_until_change(self) -> int:
        return self._left if self.mode == "cyclic" else self._interval - self.samples % self._interval

    def observe(self, x: Vector, y: Vector) -> None:
        """Learn from drive samples and the outputs that they produced."""
        done = 0
        while done < x.size:
            part = slice(done, min(done + self._left_until_change(), x.size))
            self._take(x[part], y[part])
            done = part.stop

    def _take(self, x: Vector, y: Vector) -> None:
        verdicts = self._guard.judge(self.structure.unit_input(x), self.structure.unit_output(y))
        self.samples += x.size
        if self.mode == "continuous":
            self._take_continuously(x, y, verdicts)
            return
        counting = self.phase in (Phase.BUILD, Phase.HOLD)
        for start, stop, good in runs(verdicts != Verdict.REFUSED):
            measured = y[start:stop] if good else np.zeros(stop - start)
            self._basis.update(x[start:stop], measured, count=counting and good)
        if self._learning is not None:
            self._learning.advance(x.size)
        self._left -= x.size
        refused = int(np.count_nonzero(verdicts == Verdict.REFUSED))
        if counting and np.any(verdicts == Verdict.JUMPED):
            self.log.append(Event(self.samples, "sensor", "the output jumped; the data basis starts anew"))
            self._enter(Phase.RESET)
        elif self.phase is Phase.RESET and refused:
            self._left = self._lasts[Phase.RESET]  # stays until the sensor is good for as long as that
        elif self._left <= 0:
            self._leave()

    def _leave(self) -> None:
        """Do what the end of a state brings and go to the next."""
        if self.phase is Phase.BUILD:
            if self._basis.samples <= self.structure.d:
                self.log.append(Event(self.samples, "sensor", "too few good samples in the building phase"))
                self._enter(Phase.RESET)
                return
            self._problem = self._basis.problem(reference=self.model.weights)
        elif self.phase is Phase.LEARN:
            assert self._learning is not None
            self._hand_over(self._learning.weights)
        self._enter(FOLLOWS[self.phase])

    def _enter(self, phase: Phase) -> None:
        self.phase, self._left = phase, self._lasts[phase]
        if phase in (Phase.RESET, Phase.HOLD):
            if phase is Phase.RESET:
                self._problem = self._learning = None
            self._basis.clear()
        if phase is Phase.LEARN:
            if self._problem is None or self._basis.samples == 0:
                self._enter(Phase.RESET)
                return
            self._learning = LearningPhase(self.solver, self._problem, self.model.weights, self._samples_to_solve)
            if self._learning.ready_after:
                self._left = self._learning.ready_after

    def _hand_over(self, weights: Vector) -> None:
        """Take new weights over if they pass; the data basis holds what was kept back."""
        held = self._basis.problem(proximal=0.0)
        old = float(np.sqrt(max(2.0 * held.cost(self.model.weights), 0.0)))
        new = float(np.sqrt(max(2.0 * held.cost(weights), 0.0))) if np.all(np.isfinite(weights)) else float("nan")
        self._decide(weights, old, new)

    def _decide(self, weights: Vector, old: float, new: float) -> None:
        if not new <= old:  # NaN compares false
            why = "are not finite" if np.isnan(new) else "predict held-back data worse than the old ones"
            self.log.append(Event(self.samples, "refused", f"the new weights {why}", old, new))
            return
        try:
            model = HysteresisCreepModel.from_weights(self.structure, weights)
        except ModelError as error:
            self.log.append(Event(self.samples, "refused", f"the new weights are no valid model: {error}", old, new))
            return
        self.compensator.change_model(model, self.fade_s)
        self.log.append(Event(self.samples, "hand-over", "new weights", old, new))

    def _take_continuously(self, x: Vector, y: Vector, verdicts: NDArray[np.int8]) -> None:
        learning, s = self._continuous, self.structure
        good = verdicts == Verdict.GOOD
        unit_y = np.where(good, s.unit_output(np.where(np.isfinite(y), y, 0.0)), 0.0)
        rows = learning.rows(s.unit_input(x), unit_y)
        if not np.all(good):
            self._settling = self._lasts[Phase.RESET]
            self._errors[:] = 0.0
        self._settling -= x.size
        if self._settling < 0:  # good for long enough
            kept = rows[good]
            S = s.inverse_slope_map
            for i, weights in enumerate((self.model.weights, self._candidate)):
                error = kept[:, :-1] @ (S @ weights) + kept[:, -1]
                self._errors[i] += float(error @ error)
            learning.take(kept)
        if self.samples % self._interval == 0:
            if self._errors[0] > 0.0:
                old, new = np.sqrt(self._errors / self._interval)
                self._decide(self._candidate, float(old), float(new))
                self._candidate = learning.weights
            self._errors[:] = 0.0


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int, bool]]:
    """Stretches of equal flags as (start, stop, flag).

    Examples
    --------
    >>> runs(np.array([True, True, False]))
    [(0, 2, True), (2, 3, False)]
    """
    edges = [0, *(np.flatnonzero(np.diff(flags)) + 1).tolist(), flags.size]
    return [(a, b, bool(flags[a])) for a, b in pairwise(edges) if b > a]
