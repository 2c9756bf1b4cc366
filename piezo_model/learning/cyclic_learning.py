"""Cyclic operation: the synchronous Moore machine of the paper round a compensator, see ``core/cyclic.h``.

A solver of steps (the paper's difference equation) takes one a sample, in the core, and has an answer at any time; any other solves
once at the beginning of the learning phase, here, and its answer is there after as many samples as that took.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from piezo_model.compensator import Compensator
from piezo_model.core import State, face
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning.driven_range import DrivenRange
from piezo_model.learning.events import LEARN, RESET, Brought, Log
from piezo_model.learning.learner import Learner
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.learning.solving import STEPPED, samples, solved, step_ratio
from piezo_model.model import HysteresisCreepModel


class CyclicLearning(Learner):
    """The cyclic learner of a compensator, whose model it changes."""

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log) -> None:
        s = compensator.model.structure
        core = State(face.cyclic_bytes(*s.shape), lambda block: face.cyclic_setup(block, *s.shape, s.middle))
        super().__init__(compensator, settings, log, core, face.cyclic_observe, face.cyclic_drive, DrivenRange())
        for name in ("reset", "build", "learn"):
            core.whole(f"{name}_lasts")[:] = s.samples(getattr(settings, f"{name}_s"))
        self._stepped = settings.solver == STEPPED
        core.whole("steps")[:] = self._stepped
        core["step_ratio"][:] = step_ratio(settings.solver_options) if self._stepped else 0.5
        core["proximal"][:], core["min_slope"][:] = settings.proximal, MIN_SLOPE
        compensator.fade_over(settings.fade_s)
        self._problem: IdentificationProblem | None = None
        face.cyclic_enter(core.block, RESET)

    @property
    def problem(self) -> IdentificationProblem | None:
        """What the last building phase has gathered, with what is recalled of the cycles before."""
        return self._problem

    def samples_until_change(self) -> int:
        """Samples for which the weights in use cannot change."""
        return self.count("left") + (self.count("build_lasts") if self.count("phase") == RESET else 0)

    def _follow(self, brought: Brought) -> None:
        since, solver = self.count("learning_since"), self._settings.solver
        errors = float(self.core["error_in_use"][0]), float(self.core["error_found"][0])
        if Brought.SENSOR_FAULT in brought:
            self._note("sensor", "the output jumped, froze or left its range while phase build lasted; it starts anew",
                       learning_since=since)
        elif Brought.UNEXCITED in brought:
            low, high = self.core["covered"][:2]
            self._note("refused", f"the drive went through {50 * (high - low):.1f} % of its range only, and 2 % are needed",
                       learning_since=since)
        elif Brought.PROGRAM in brought:
            self._problem = self._gathered()
            if not self._stepped:
                self._solve()
        elif Brought.NOT_A_NUMBER in brought:
            self._note("refused", f"the solver {solver} found no finite weights", since)
        elif Brought.WORSE in brought:
            self._note("refused", "the new weights explain the data worse than the old ones", since, *errors)
        else:
            self._note("hand-over", "new weights", since, *errors)
        if Brought.CYCLE_OVER in brought and self._follow_range(self.core["covered"]):
            self.core["past_share"][:] = 0.0

    def _solve(self) -> None:
        from qpsolvers import Problem

        core, s = self.core, self._compensator.model.structure
        program = Problem(core["P"].reshape(s.d, s.d).copy(), core["q"].copy(), lb=core["lower"].copy(), ub=np.full(s.d, np.inf))
        try:
            answer, seconds = solved(self._settings.solver, self._settings.solver_options, program, core["start"].copy(),
                                     0.5 * float(core["data"][0]))
        except Exception as error:  # whatever a library does, the drive goes on
            core.whole("refusals")[:] += 1
            face.cyclic_enter(core.block, RESET)
            self._note("refused", f"the solver {self._settings.solver} failed: {error}", self.count("learning_since"))
            return
        core["answer"][:] = answer
        core.whole("left")[:] = self._settings.samples_to_solve or samples(seconds, s.sample_time)

    def _gathered(self) -> IdentificationProblem:
        """The problem of the core's data, which are in slopes."""
        core, s = self.core, self._compensator.model.structure
        products, S = np.zeros((s.d + 1, s.d + 1)), s.inverse_slope_map
        products[np.triu_indices(s.d + 1)] = core["data"]
        products = products + np.triu(products, 1).T
        x_min, x_max, y_min, y_max = core["covered"].tolist()
        r, creep = core["r"], core["start_creep"].reshape(-1, s.lanes)
        play_moved = (x_max - r > core["start_play"]) | (x_min + r < core["start_play"])
        creep_moved = np.any((x_max - r > creep) | (x_min + r < creep), axis=0)
        excitation = Excitation(x_min, x_max, y_min, y_max, tuple(play_moved[1:s.n + 1].tolist()),
                                tuple(creep_moved[:s.creep_weights].tolist()))
        return IdentificationProblem(s, S.T @ products[1:, 1:] @ S, S.T @ products[0, 1:], 0.5 * float(products[0, 0]), excitation,
                                     s.slope_map @ core["reference"], self._settings.proximal, MIN_SLOPE)

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; the compensator has been restored before."""
        super().restore(memory)
        self._problem = self._gathered() if self.count("phase") == LEARN else None


def with_constant(model: HysteresisCreepModel) -> HysteresisCreepModel:
    """Return the same model in a structure that has a constant, which is zero so far."""
    return replace(model, structure=replace(model.structure, offset=True))
