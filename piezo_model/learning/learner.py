"""The learner of a compensator: a state of the core, whose weights it changes, and what the core has to tell.

Each sample and each block is the core's business (``core/controller.h``, ``core/learner.h``); it comes back to Python
where there is something to tell: an event for the log, a program for a solver, a range to look at. Cyclic and
continuous operation are settings.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.compensator import Compensator
from piezo_model.core import State, bindings
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.learning import layout
from piezo_model.learning.driven_range import PIECE_S, DrivenRange, carried_over
from piezo_model.learning.events import LOG_LENGTH, RESET, BlockEvent, Event, Log
from piezo_model.learning.layout import ANSWERED, CLOCK, CONTINUOUS, CYCLIC, MEMORY, STEPS
from piezo_model.learning.program import gathered
from piezo_model.learning.settings import EXACT_SOLVERS, MIN_SLOPE, LearningSettings
from piezo_model.learning.solving import STEPPED, solved, step_ratio
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import write_slope_regressors
from solvers.core import padded

MESSAGES = {
    BlockEvent.FIRST: ("hand-over", "the first new weights since learning began; further ones are counted only"),
    BlockEvent.OTHER_SENSOR: ("sensor", "the output is not what it was before the fault; learning begins anew"),
    BlockEvent.NO_OPTIMUM: ("refused", "the data have no optimum; learning begins anew"),
}
"""Of continuous operation, where further hand-overs and refusals are counted only."""


class Learner:
    """What a :class:`piezo_model.self_learning.SelfLearningCompensator` is besides its methods."""

    def __init__(self, compensator: Compensator, settings: LearningSettings) -> None:
        self.compensator, self.settings = compensator, settings
        self.log: Log = deque(maxlen=LOG_LENGTH)
        self.problem: IdentificationProblem | None = None
        s = compensator.model.structure
        self._cyclic = settings.mode == "cyclic"
        self._block, numbers = (
            self._cyclic_numbers()
            if self._cyclic
            else layout.continuous_numbers(s, settings.hand_over_s, settings.memory_s, settings.reset_s)
        )
        """Samples of a block."""
        if not self._cyclic and settings.solver not in EXACT_SOLVERS:
            numbers["solver"] = ANSWERED
        sizes = *s.shape, self._block, 1, CYCLIC if self._cyclic else CONTINUOUS
        self._core = State(bindings.learner_bytes(*sizes), lambda memory: bindings.learner_setup(memory, *sizes))
        layout.write_settings(numbers, self._core["settings"])
        self._core.whole("delay")[:] = self._block
        write_slope_regressors(self._core, s)
        self._driven = DrivenRange() if self._cyclic else DrivenRange(round(PIECE_S / layout.CHECKPOINT_S))
        compensator.fade_over(settings.fade_s)
        self._core["in_use"][:] = s.inverse_slope_map @ compensator.model.weights
        bindings.learner_begin(
            self._core.block, compensator.block, compensator.state.play, compensator.state.creep, True
        )

    def _cyclic_numbers(self) -> tuple[int, dict[str, float]]:
        s, settings = self.compensator.model.structure, self.settings
        lasts = {f"{name}_lasts": s.samples(getattr(settings, f"{name}_s")) for name in ("reset", "build", "learn")}
        stepped = settings.solver == STEPPED
        return layout.block_samples(tuple(lasts.values())), {
            "way": CYCLIC,
            "solver": STEPS if stepped else ANSWERED,
            "middle": s.middle,
            **lasts,
            "solve_lasts": settings.samples_to_solve,
            "forgetting": 1.0,
            "share": 1.0,
            "proximal": settings.proximal,
            "min_slope": MIN_SLOPE,
            "step_ratio": step_ratio(settings.solver_options) if stepped else 0.5,
        }

    def _count(self, name: str) -> int:
        """A number of the core's memory (``MEMORY`` of `layout`)."""
        return int(self._core["memory"][MEMORY.index(name)])

    def _clock(self, name: str) -> int:
        return int(self._core.whole("clock")[CLOCK.index(name)])

    def _until_done(self, samples: int, call: Callable[[int, NDArray[np.int64]], int]) -> None:
        """Go through samples by a function of the core, which takes the first and returns how many are done when there
        is something to tell."""
        done, events = 0, np.zeros(1, dtype=np.int64)
        with self._core.alone():
            while done < samples:
                done = call(done, events)
                if events[0]:
                    self._follow(BlockEvent(int(events[0])))

    def _follow(self, events: BlockEvent) -> None:
        """Note what came of a block, and do what is Python's part."""
        if BlockEvent.SENSOR_FAULT in events:
            self._driven.interrupt()
            self._note("sensor", "the output jumped, froze or left its range; learning waits")
        if BlockEvent.PROGRAM in events:
            self._solve()
        for one, (what, message) in MESSAGES.items():
            if one in events:
                self._note(what, message)
        if self._cyclic:
            self._follow_cycle(events)
        if BlockEvent.LOOK in events or BlockEvent.CYCLE_OVER in events:
            self._follow_range()

    def _follow_cycle(self, events: BlockEvent) -> None:
        errors = (
            float(self._core["clock"][CLOCK.index("error_in_use")]),
            float(self._core["clock"][CLOCK.index("error_found")]),
        )
        if BlockEvent.UNEXCITED in events:
            low, high = self._core["covered"][:2]
            self._note(
                "refused", f"the drive went through {50 * (high - low):.1f} % of its range only, and 2 % are needed"
            )
        elif BlockEvent.NOT_A_NUMBER in events:
            self._note("refused", f"the solver {self.settings.solver} found no finite weights")
        elif BlockEvent.WORSE in events:
            self._note("refused", "the new weights explain the data worse than the old ones", *errors)
        elif BlockEvent.CYCLE_OVER in events:
            self._note("hand-over", "new weights", *errors)

    def _note(self, what: Any, message: str, old: float = math.nan, new: float = math.nan) -> None:
        self.log.append(
            Event(
                int(self._core.whole("samples")[0]),
                what,
                message,
                old,
                new,
                self._clock("learning_since") if self._cyclic else 0,
            )
        )

    def _solve(self) -> None:
        """Have the program of the core solved."""
        core, s = self._core, self.compensator.model.structure
        if self._cyclic:
            self.problem = gathered(core, s, self.settings.proximal)
            if self.settings.solver == STEPPED:
                return
            P, q, lower = core["P"].reshape(s.d, s.d).copy(), core["q"].copy(), core["lower"].copy()
            start, c = core["start"].copy(), 0.5 * float(core["data"][0])
        else:
            P, q, lower = np.empty((s.d, s.d)), np.empty(s.d), np.empty(s.d)
            bindings.learner_program(core.block, P, q, lower)
            start, c = np.maximum(core["candidate"], lower), 0.5 * float(core["gram"][s.d * padded(s.d + 1) + s.d])
        from qpsolvers import Problem  # which imports every solver that is installed

        program = Problem(P, q, lb=lower, ub=np.full(q.size, np.inf))
        try:
            found = solved(self.settings.solver, self.settings.solver_options, program, start, c)
        except Exception as error:  # whatever a library does, the drive goes on
            core["memory"][MEMORY.index("refusals")] += 1
            if self._cyclic:
                bindings.cyclic_enter(core.block, RESET)
            self._note("refused", f"the solver {self.settings.solver} failed: {error}")
            return
        if self._cyclic:
            core["answer"][:] = found
        elif np.all(np.isfinite(found)):
            core["candidate"][:] = np.maximum(found, lower)

    def _follow_range(self) -> None:
        """Go on in other ranges, where those that were driven are others."""
        core, old = self._core, self.compensator.model.structure
        span = core["covered"] if self._cyclic else core["memory"][MEMORY.index("span") :]
        new = self._driven.look(span, old) if self.settings.follow_range and np.all(np.isfinite(span)) else None
        if not self._cyclic:
            span[:] = math.inf, -math.inf, math.inf, -math.inf
        if new is None:
            return
        state = OperatorState(core["block_play"], core["block_creep"]).on(old, new)
        level = core["memory"][MEMORY.index("level")] * (old.x_scale / new.x_scale) ** 2
        # perhaps offered and not yet taken
        learned = HysteresisCreepModel.from_weights(old, old.slope_map @ core["in_use"])
        self.compensator.change_model(carried_over(learned, new), self.settings.fade_s)
        core["in_use"][:] = new.inverse_slope_map @ self.compensator.model.weights
        core["memory"][MEMORY.index("level")] = level
        bindings.learner_begin(core.block, self.compensator.block, state.play, state.creep, False)
        if self._cyclic:
            core["clock"][CLOCK.index("past_share")] = 0.0
        self._note("range", "the thresholds follow the range that was driven")
