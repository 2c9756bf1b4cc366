"""Cyclic operation: the synchronous Moore machine of the paper round a compensator.

    reset  →  build  →  hold  →  learn  →  reset, with the new weights if they pass

What is done with each sample stands in `cyclic_step`; here is what happens between two phases. The operators follow the
actuator in every phase; ``reset`` clears P, q and c and never the states. A fault of the sensor sends the machine to ``reset``,
where it stays until samples have been good for as long as that lasts.

New weights are taken over only if

- the drive of the building phase went through at least MIN_EXCITATION of its range;
- they are finite and the weights of a valid model;
- they predict the held-back part at least as well as those in use.

What the drive did not reach stays as it was, since the problem's reference are the weights in use. But small movements would lead
what they hardly excite astray, a little in every cycle. So the data of the last wide cycle, with its weights w_a as their
optimum, are part of the cost of a cycle that is much narrower, with a small weight: P + β P_a, q − β P_a w_a.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.compensator import Compensator
from piezo_model.data_basis import DataBasis
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning import cyclic_step as step
from piezo_model.learning.events import BUILD, FAULT, HOLD, LEARN, NONE, PHASES, RESET, Event, Log, Phase
from piezo_model.learning.loop_centre import centred
from piezo_model.learning.phase import LearningPhase, no_steps
from piezo_model.learning.sensor_guard import fresh_memory
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.model import HysteresisCreepModel, ModelError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

MIN_EXCITATION = 0.02
"""Smallest share of the drive's range that new weights may come from."""
NARROW, RECALL = 0.8, 1e-3
"""A cycle is narrow if its drive covers less than NARROW times what the last wide one covered; RECALL is β."""


@dataclass(frozen=True)
class WideCycle:
    """Data and weights of the last cycle that was not narrow."""

    P: Matrix
    weights: Vector
    share: float

    def added_to(self, problem: IdentificationProblem) -> IdentificationProblem:
        """Return the problem with the data of the wide cycle, as far as they are known by its optimum, in its cost."""
        P, w = RECALL * self.P, self.weights
        return replace(problem, P=problem.P + P, q=problem.q - P @ w, c=problem.c + 0.5 * float(w @ P @ w))


class CyclicLearning:
    """The machine of the module.

    Parameters
    ----------
    compensator : Compensator
        Whose model it changes.
    settings : LearningSettings
    log : deque of Event
    find_centre : bool
        Whether the structure moves to its loop's centre with the first hand-over, which takes a model with a constant.
    """

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log, find_centre: bool) -> None:
        self._compensator, self._settings, self._log, self._find_centre = compensator, settings, log, find_centre
        seconds = (settings.reset_s, settings.build_s * (1.0 - settings.hold_back), settings.build_s * settings.hold_back,
                   settings.learn_s)
        self._lasts = [max(1, round(value / compensator.model.structure.sample_time)) for value in seconds]
        self.guard, self.counts = fresh_memory(), np.zeros(step.VERDICTS + 4, dtype=np.int64)
        self.counts[step.RESET_LASTS] = self._lasts[RESET]
        self._basis = DataBasis(compensator.model.structure, compensator.state)
        self._wide: WideCycle | None = None
        self._enter(RESET)

    @property
    def phase(self) -> Phase:
        """The phase that it is in."""
        return PHASES[self.counts[step.PHASE]]

    @property
    def problem(self) -> IdentificationProblem | None:
        """What the building phase has gathered, from its end to that of the learning phase."""
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
        self._log.append(Event(int(self.counts[step.SAMPLE]), what, message, old, new))

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
        elif phase == HOLD:
            self._begin_to_learn()
        else:
            self._hand_over()
            self._enter(RESET)

    def _enter(self, phase: int, lasts: int = 0) -> None:
        self.counts[step.PHASE], self.counts[step.LEFT] = phase, lasts or self._lasts[phase]
        if phase in (RESET, HOLD):
            self._basis.clear()
        if phase == RESET:
            self._problem: IdentificationProblem | None = None
            self._learning: LearningPhase | None = None
        self._gather_arrays()

    def _gather_arrays(self) -> None:
        solver = no_steps() if self._learning is None else self._learning.arrays
        self._arrays = step.CyclicArrays(self._basis.arrays, self._compensator.limits, self.guard, self.counts, solver)

    def _end_of_build(self) -> None:
        share = _share(self._basis.excitation)
        if share < MIN_EXCITATION:
            self._refuse(f"the drive went through {100 * share:.1f} % of its range only, and {100 * MIN_EXCITATION:g} % are needed")
            self._enter(RESET)
            return
        self._problem = self._basis.problem(self._compensator.model.weights, proximal=self._settings.proximal,
                                            min_slope=MIN_SLOPE)
        self._enter(HOLD)

    def _is_narrow(self, problem: IdentificationProblem) -> bool:
        return self._wide is not None and _share(problem.excitation) < NARROW * self._wide.share

    def _with_recall(self, problem: IdentificationProblem) -> IdentificationProblem:
        return self._wide.added_to(problem) if self._wide is not None and self._is_narrow(problem) else problem

    def _begin_to_learn(self) -> None:
        assert self._problem is not None
        try:
            self._learning = LearningPhase(self._settings.solver, self._with_recall(self._problem), self._compensator.model.weights,
                                           self._settings.samples_to_solve, self._settings.solver_options)
        except Exception as error:  # whatever a library does, the drive goes on
            self._refuse(f"the solver {self._settings.solver} failed: {error}")
            self._enter(RESET)
            return
        self._enter(LEARN, self._learning.ready_after)

    def _refuse(self, why: str, old: float = np.nan, new: float = np.nan) -> None:
        self.counts[step.REFUSALS] += 1
        self._note("refused", why, old, new)

    def _hand_over(self) -> None:
        """Take new weights over if they pass; the data basis holds what was kept back."""
        assert self._learning is not None
        assert self._problem is not None
        weights, held = self._learning.weights, self._basis.problem(proximal=0.0)
        if not np.all(np.isfinite(weights)):
            self._refuse(f"the solver {self._settings.solver} found no finite weights")
            return
        old, new = (float(np.sqrt(max(2.0 * held.cost(w), 0.0))) for w in (self._compensator.model.weights, weights))
        if new > old:
            self._refuse("the new weights predict held-back data worse than the old ones", old, new)
            return
        try:
            model = HysteresisCreepModel.from_weights(held.structure, weights)
            model = centred(model) if self._find_centre else model
        except ModelError as error:
            self._refuse(f"the new weights are no valid model: {error}", old, new)
            return
        self._compensator.change_model(model, self._settings.fade_s)
        self.counts[step.HAND_OVERS] += 1
        self._note("hand-over", "new weights", old, new)
        if not self._is_narrow(self._problem):
            self._wide = WideCycle(self._problem.P, weights, _share(self._problem.excitation))
        if self._find_centre:
            self._find_centre, self._wide = False, None
            self._basis = DataBasis(model.structure, self._basis.state)
            self.guard[:] = fresh_memory()

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, copied."""
        problem = None if self._problem is None else {
            "P": self._problem.P, "q": self._problem.q, "c": self._problem.c, "reference": np.asarray(self._problem.reference),
            "excitation": asdict(self._problem.excitation)}
        return {"counts": self.counts.copy(), "guard": self.guard.copy(), "basis": self._basis.memory(),
                "find_centre": self._find_centre, "problem": problem, "wide": None if self._wide is None else asdict(self._wide),
                "answer": None if self._learning is None else self._learning.answer.copy()}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; the compensator has been restored before."""
        structure = self._compensator.model.structure
        for name in ("counts", "guard"):
            getattr(self, name)[:] = memory[name]
        self._find_centre = bool(memory["find_centre"])
        self._basis = DataBasis(structure, self._compensator.state)
        self._basis.restore(memory["basis"])
        saved, answer = memory["problem"], memory["answer"]
        self._problem = None if saved is None else IdentificationProblem(
            structure, saved["P"], saved["q"], saved["c"], _excitation(saved["excitation"]), saved["reference"],
            self._settings.proximal, MIN_SLOPE)
        self._wide = None if memory["wide"] is None else WideCycle(**memory["wide"])
        self._learning = None
        if answer is not None and self._problem is not None:
            self._learning = LearningPhase(self._settings.solver, self._with_recall(self._problem), self._compensator.model.weights,
                                           options=self._settings.solver_options, answer=answer)
        self._gather_arrays()


def _share(excitation: Excitation) -> float:
    """Share of the drive's range that was covered."""
    return 0.5 * (excitation.x_max - excitation.x_min)


def _excitation(data: Mapping[str, Any]) -> Excitation:
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}
    return Excitation(**values)


def with_constant(model: HysteresisCreepModel) -> HysteresisCreepModel:
    """Return the same model in a structure that has a constant, which is zero so far."""
    return replace(model, structure=replace(model.structure, offset=True))
