"""Cyclic operation: the synchronous Moore machine of the paper round a compensator.

    reset  →  build  →  learn  →  reset, with the new weights

What is done with each sample stands in `cyclic_step`; here is what happens between two phases. The operators follow the
actuator in every phase; ``reset`` clears P, q and c and never the states. A fault of the sensor sends the machine to ``reset``,
where it stays until samples have been good for as long as that lasts.

Nothing is kept back: new weights are those of all the data, and data that came before have a part in them. With V the mean
cost of this cycle's data, V_p that of the cycles before, and w the weights in use, what is solved and what is remembered are

    (V + b V_p) / (1 + b),   b = RECALL · min(V(w) / V_p(w), V_p(w) / V(w))

the one with the w that learning begins with, the other, which takes the place of V_p, with those that it ends with. A cycle that covers other
amplitudes or places than the last one does not undo it, but data at odds with each other, a sensor that was zeroed anew
or a reference gone wild, are forgotten at once.

A cycle whose drive covers less than NARROW of what V_p covers is not remembered, for small movements would lead astray what
they hardly excite; but each of them takes a tenth off what V_p is said to cover, so no wide one is for ever.

New weights are taken over if the drive of the building phase went through at least MIN_EXCITATION of its range, and if they
are finite, make a valid model, and explain what they were learned from no worse than those in use: that is what a solver
can have done wrong. What the drive did not reach stays as it was, since the problem's reference are the weights in use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.compensator import Compensator
from piezo_model.data_basis import DataBasis
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning import cyclic_step as step
from piezo_model.learning.driven_range import DrivenRange, carried_over
from piezo_model.learning.events import BUILD, FAULT, LEARN, NONE, PHASES, RESET, Event, Log, Phase
from piezo_model.learning.phase import LearningPhase, no_steps
from piezo_model.learning.sensor_guard import fresh_memory
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.model import HysteresisCreepModel, ModelError

Vector = NDArray[np.float64]

MIN_EXCITATION = 0.02
"""Smallest share of the drive's range that new weights may come from."""
SMALLEST = 1e-30
"""Costs below are those of rounding."""
RECALL = 0.3
"""Part that the cycles before have in a problem, where their data agree with the new ones."""

NARROW, SHRINKING = 0.8, 0.9


def recalled(now: IdentificationProblem, past: IdentificationProblem | None, weights: Vector) -> IdentificationProblem:
    """Return (V + b V_p) / (1 + b) of the module; the cost of this cycle alone where there is no other."""
    if past is None:
        return now
    new, old = max(now.cost(weights), SMALLEST), max(past.cost(weights), SMALLEST)
    b = RECALL * min(new / old, old / new)
    return replace(now, P=(now.P + b * past.P) / (1.0 + b), q=(now.q + b * past.q) / (1.0 + b), c=(now.c + b * past.c) / (1.0 + b))


class CyclicLearning:
    """The machine of the module.

    Parameters
    ----------
    compensator : Compensator
        Whose model it changes.
    settings : LearningSettings
    log : deque of Event
    """

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log) -> None:
        self._compensator, self._settings, self._log = compensator, settings, log
        seconds = (settings.reset_s, settings.build_s, settings.learn_s)
        self._lasts = [max(1, round(value / compensator.model.structure.sample_time)) for value in seconds]
        self.guard, self.counts = fresh_memory(), np.zeros(step.VERDICTS + 4, dtype=np.int64)
        self.counts[step.RESET_LASTS] = self._lasts[RESET]
        self._basis = DataBasis(compensator.model.structure, compensator.state)
        self._past: IdentificationProblem | None = None
        self._problem: IdentificationProblem | None = None
        self._past_share, self._learns_since = 0.0, 0
        self._driven = DrivenRange()
        self._enter(RESET)

    @property
    def phase(self) -> Phase:
        """The phase that it is in."""
        return PHASES[self.counts[step.PHASE]]

    @property
    def problem(self) -> IdentificationProblem | None:
        """What the last building phase has gathered, with what is recalled of the cycles before."""
        return self._problem

    def samples_until_change(self) -> int:
        """Samples for which the weights in use cannot change."""
        phase = int(self.counts[step.PHASE])
        return int(self.counts[step.LEFT]) + sum(self._lasts[phase + 1:LEARN])

    def observe(self, x: Vector, y: Vector) -> None:
        """Learn from drive samples and the outputs that they produced."""
        done = 0
        while done < x.size:
            done, signal = step.observe(self._arrays, x, y, done)
            self._follow(signal)

    def drive_and_observe(self, y_ref: Vector, y: Vector) -> Vector:
        """Drive samples (N,), each followed by learning from the output (N,) that it produced."""
        done, x = 0, np.empty_like(y_ref)
        while done < x.size:
            c = self._compensator
            done, signal = step.drive_and_observe(self._arrays, c.inverse, c.state.play, c.state.creep, c.fade, y_ref, y, x, done)
            self._follow(signal)
        return x

    def _note(self, what: Any, message: str, old: float = np.nan, new: float = np.nan) -> None:
        self._log.append(Event(int(self.counts[step.SAMPLE]), what, message, old, new, self._learns_since))

    def _follow(self, signal: int) -> None:
        """Do what the end of a phase, or a fault, brings."""
        if signal == NONE:
            return
        phase = self.counts[step.PHASE]
        if signal == FAULT:
            self._note("sensor", f"the output jumped, froze or left its range while phase {self.phase} lasted; it starts anew")
            self._enter(RESET)
        elif phase == RESET:
            self._enter(BUILD)
        elif phase == BUILD:
            self._end_of_build()
        else:
            self._hand_over()
            self._follow_range()
            self._enter(RESET)

    def _enter(self, phase: int, lasts: int = 0) -> None:
        self.counts[step.PHASE], self.counts[step.LEFT] = phase, lasts or self._lasts[phase]
        if phase == RESET:
            self._basis.clear()
            self._learning: LearningPhase | None = None
        self._gather_arrays()

    def _gather_arrays(self) -> None:
        solver = no_steps() if self._learning is None else self._learning.arrays
        self._arrays = step.CyclicArrays(self._basis.arrays, self._compensator.limits, self.guard, self.counts, solver)

    def _end_of_build(self) -> None:
        self._learns_since = int(self.counts[step.SAMPLE])
        share, weights = _share(self._basis.excitation), self._compensator.model.weights
        if share < MIN_EXCITATION:
            self._refuse(f"the drive went through {100 * share:.1f} % of its range only, and {100 * MIN_EXCITATION:g} % are needed")
            self._enter(RESET)
            return
        self._problem = recalled(self._this_cycle(), self._past, weights)
        try:
            self._learning = LearningPhase(self._settings.solver, self._problem, weights, self._settings.samples_to_solve,
                                           self._settings.solver_options)
        except Exception as error:  # whatever a library does, the drive goes on
            self._refuse(f"the solver {self._settings.solver} failed: {error}")
            self._enter(RESET)
            return
        self._enter(LEARN, self._learning.ready_after)

    def _this_cycle(self) -> IdentificationProblem:
        return self._basis.problem(self._compensator.model.weights, proximal=self._settings.proximal, min_slope=MIN_SLOPE)

    def _refuse(self, why: str, old: float = np.nan, new: float = np.nan) -> None:
        self.counts[step.REFUSALS] += 1
        self._note("refused", why, old, new)

    def _hand_over(self) -> None:
        """Take new weights over if they pass."""
        assert self._learning is not None
        assert self._problem is not None
        weights, problem = self._learning.weights, self._problem
        if not np.all(np.isfinite(weights)):
            self._refuse(f"the solver {self._settings.solver} found no finite weights")
            return
        old, new = (float(np.sqrt(max(2.0 * problem.cost(w), 0.0))) for w in (self._compensator.model.weights, weights))
        if new > old:
            self._refuse("the new weights explain the data worse than the old ones", old, new)
            return
        try:
            model = HysteresisCreepModel.from_weights(problem.structure, weights)
        except ModelError as error:
            self._refuse(f"the new weights are no valid model: {error}", old, new)
            return
        self._compensator.change_model(model, self._settings.fade_s)
        self.counts[step.HAND_OVERS] += 1
        self._note("hand-over", "new weights", old, new)
        share = _share(problem.excitation)
        if share < NARROW * self._past_share:
            self._past_share *= SHRINKING
        else:
            self._past, self._past_share = recalled(self._this_cycle(), self._past, weights), share

    def _follow_range(self) -> None:
        """Go on in other ranges, where those that are driven are others."""
        if not self._settings.follow_range:
            return
        e, old = self._basis.excitation, self._compensator.model.structure
        new = self._driven.look((e.x_min, e.x_max, e.y_min, e.y_max), old)
        if new is not None:
            self._compensator.change_model(carried_over(self._compensator.model, new), self._settings.fade_s)
            self._basis = DataBasis(new, self._basis.state.on(old, new))
            self._past, self._past_share, self.guard[:] = None, 0.0, fresh_memory()
            self._note("range", "the thresholds follow the range that was driven")

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, copied."""
        return {"counts": self.counts.copy(), "guard": self.guard.copy(), "basis": self._basis.memory(),
                "problem": None if self._learning is None else _saved(self._problem), "past": _saved(self._past),
                "past_share": self._past_share, "driven": self._driven.memory(), "learns_since": self._learns_since,
                "answer": None if self._learning is None else self._learning.answer.copy()}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; the compensator has been restored before."""
        structure = self._compensator.model.structure
        for name in ("counts", "guard"):
            getattr(self, name)[:] = memory[name]
        self._basis = DataBasis(structure, self._compensator.state)
        self._basis.restore(memory["basis"])
        self._problem, self._past = (self._restored(memory[name]) for name in ("problem", "past"))
        self._past_share, self._learns_since = float(memory["past_share"]), int(memory["learns_since"])
        self._driven.restore(memory["driven"])
        answer, self._learning = memory["answer"], None
        if answer is not None and self._problem is not None:
            self._learning = LearningPhase(self._settings.solver, self._problem, self._compensator.model.weights,
                                           options=self._settings.solver_options, answer=answer)
        self._gather_arrays()

    def _restored(self, saved: Mapping[str, Any] | None) -> IdentificationProblem | None:
        if saved is None:
            return None
        values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value
                                  for name, value in saved["excitation"].items()}
        return IdentificationProblem(self._compensator.model.structure, saved["P"], saved["q"], saved["c"], Excitation(**values),
                                     saved["reference"], self._settings.proximal, MIN_SLOPE)


def _share(excitation: Excitation) -> float:
    """Share of the drive's range that was covered."""
    return 0.5 * (excitation.x_max - excitation.x_min)


def _saved(problem: IdentificationProblem | None) -> dict[str, Any] | None:
    return None if problem is None else {"P": problem.P, "q": problem.q, "c": problem.c, "reference": np.asarray(problem.reference),
                                         "excitation": asdict(problem.excitation)}


def with_constant(model: HysteresisCreepModel) -> HysteresisCreepModel:
    """Return the same model in a structure that has a constant, which is zero so far."""
    return replace(model, structure=replace(model.structure, offset=True))
