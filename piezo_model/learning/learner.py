"""The learner of a compensator: a state of the core that changes the compensator's weights, and what Python adds.

The core handles samples and blocks (``core/controller.h``, ``core/learner.h``). Python handles its events: it writes
the log, calls solvers outside the core, and adapts the ranges. Cyclic and continuous operation differ in settings.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import solvers
from piezo_model.compensator import Compensator
from piezo_model.core import State, Stateful, bindings
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning import layout
from piezo_model.learning.driven_range import PIECE_S, DrivenRange, carried_over
from piezo_model.learning.events import BlockEvent, Event, Phase
from piezo_model.learning.layout import CONTINUOUS, CYCLIC
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.learning.solving import STEPPED, solved
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import full_gram, write_slope_regressors

LOG_LENGTH = 1000
"""Number of events kept."""
REVERSED = (
    "the output falls as the input rises, so the weights in use stay; reverse the sensor, or give y_range in "
    "descending order"
)
MESSAGES = {
    BlockEvent.SENSOR_FAULT: ("sensor", "the output jumped, froze or left its range; learning waits"),
    BlockEvent.FIRST: ("hand-over", "the first new weights since learning began; further ones are counted only"),
    BlockEvent.OTHER_SENSOR: ("sensor", "the output is not what it was before the fault; learning begins anew"),
    BlockEvent.NO_OPTIMUM: ("refused", "the data have no optimum; learning begins anew"),
    BlockEvent.REVERSED: ("refused", REVERSED),
    BlockEvent.UNEXCITED: (
        "refused",
        "the drive went through {percent:.1f} % of its range only, and 2 % are needed",
    ),
    BlockEvent.NOT_A_NUMBER: ("refused", "the solver {solver} found no finite weights"),
    BlockEvent.WORSE: ("refused", "the new weights explain the data worse than the old ones"),
    BlockEvent.CYCLE_OVER: ("hand-over", "new weights"),
}
"""Log entries of events. Further hand-overs and refusals of continuous operation, and further refusals of a reversed
output, are only counted."""


class Learner(Stateful):
    """Base of :class:`piezo_model.self_learning.SelfLearningCompensator`: settings, state and event handling."""

    def __init__(self, compensator: Compensator, settings: LearningSettings) -> None:
        self.compensator, self.settings = compensator, settings
        self.log: deque[Event] = deque(maxlen=LOG_LENGTH)
        self.problem: IdentificationProblem | None = None
        s = compensator.model.structure
        self._cyclic = settings.mode == "cyclic"
        self._block, numbers = layout.learner_numbers(s, settings)
        """Samples of a block."""
        sizes = *compensator.shape, self._block, 1, CYCLIC if self._cyclic else CONTINUOUS
        self._core = State(bindings.learner_bytes(*sizes), lambda memory: bindings.learner_setup(memory, *sizes))
        layout.write_settings(numbers, self._core["settings"])
        self._core.as_int64("delay")[:] = self._block
        write_slope_regressors(self._core, s)
        self._driven = DrivenRange() if self._cyclic else DrivenRange(round(PIECE_S / layout.CHECKPOINT_S))
        self._follow_dynamics()
        compensator.set_blend_time(settings.blend_time_s)
        self._begin(compensator.state, resets=True)

    def _follow_dynamics(self) -> None:
        """Take over the noise behind the compensator's prefilter."""
        self._core["noise_gains"][:] = self.compensator.prefilter.noise_gains

    def _begin(self, state: OperatorState, resets: bool) -> None:
        """Begin to learn from the compensator's model and these states of the operators."""
        model = self.compensator.model
        self._core["in_use"][:] = model.structure.inverse_slope_map @ model.weights
        bindings.learner_begin(self._core.block, self.compensator.block, state.play, state.creep, resets)

    @property
    def _memory(self) -> np.void:
        """The core's ``LearnerMemory``."""
        return self._core.record("memory", layout.MEMORY)

    @property
    def _clock(self) -> np.void:
        """The core's ``LearnerClock``."""
        return self._core.record("clock", layout.CLOCK)

    def _until_done(self, samples: int, call: Callable[[int, NDArray[np.int64]], int], observed: bool = False) -> None:
        """Process samples by a function of the core that takes the number of the first one, stops at events, and
        returns the number of samples done. A sample that is ``observed``, or had events, is to be driven only."""
        done, events = 0, np.full(1, observed, dtype=np.int64)
        with self._core.exclusive():
            while done < samples:
                done = call(done, events)
                if events[0]:
                    self._follow(BlockEvent(int(events[0])))

    def _follow(self, events: BlockEvent) -> None:
        """Handle the events of a block that need Python, and log them."""
        if BlockEvent.SENSOR_FAULT in events:
            self._driven.interrupt()
        if BlockEvent.PROGRAM in events:
            self._solve()
        refused, judged = BlockEvent.NOT_A_NUMBER | BlockEvent.WORSE, BlockEvent.WORSE | BlockEvent.CYCLE_OVER
        for event, (what, message) in MESSAGES.items():
            if event in events and not (event is BlockEvent.CYCLE_OVER and events & refused):
                low, high = self._core["covered"][:2] if self._cyclic else (0.0, 0.0)
                errors = ("error_in_use", "error_found") if event & judged else ()
                self._note(
                    what,
                    message.format(percent=50.0 * (high - low), solver=self.settings.solver),
                    *(float(self._clock[name]) for name in errors),
                )
        if events & (BlockEvent.CHECK_RANGE | BlockEvent.CYCLE_OVER):
            self._adapt_range()

    def _note(self, what: Any, message: str, old: float = math.nan, new: float = math.nan) -> None:
        sample, since = int(self._core.as_int64("samples")[0]), int(self._clock["learning_since"])
        self.log.append(Event(sample, what, message, old, new, since))

    def _gathered(self) -> IdentificationProblem:
        """The problem of a cycle's data, which the core has in slopes."""
        core, s = self._core, self.compensator.model.structure
        gram, S = full_gram(core["data"], s), s.inverse_slope_map
        return IdentificationProblem(
            s,
            S.T @ gram[:-1, :-1] @ S,
            S.T @ gram[:-1, -1],
            0.5 * float(gram[-1, -1]),
            Excitation.of(s, core["covered"], core["r"], core["start_play"], core["start_creep"]),
            s.slope_map @ core["reference"],
            self.settings.proximal,
            MIN_SLOPE,
        )

    def _solve(self) -> None:
        """Solve the program of the core."""
        core, s = self._core, self.compensator.model.structure
        if self._cyclic:
            self.problem = self._gathered()
            if self.settings.solver == STEPPED:
                return
        else:
            bindings.learner_program(core.block)
        P, q, lower = core["P"].reshape(s.d, s.d).copy(), core["q"].copy(), core["lower"].copy()
        c = 0.5 * float(full_gram(core["data" if self._cyclic else "gram"], s)[-1, -1])
        program = solvers.Problem(P, q, lb=lower, ub=np.full(q.size, np.inf))
        start = np.maximum(core["start"], lower)
        try:
            answer = solved(self.settings.solver, self.settings.solver_options, program, start, c)
        except Exception as error:  # no exception of a library may stop the compensator
            self._memory["refusals"] += 1
            if self._cyclic:
                bindings.cyclic_enter(core.block, list(Phase).index(Phase.RESET))
            self._note("refused", f"the solver {self.settings.solver} failed: {error}")
            return
        if self._cyclic:
            core["answer"][:] = answer
        elif np.all(np.isfinite(answer)):
            core["candidate"][:] = np.maximum(answer, lower)

    def _adapt_range(self) -> None:
        """Change to other ranges if the drive or the output needs them."""
        core, old = self._core, self.compensator.model.structure
        span = core["covered"] if self._cyclic else self._memory["span"]
        new = self._driven.observe(span, old) if self.settings.adapt_range and np.all(np.isfinite(span)) else None
        if not self._cyclic:
            span[:] = math.inf, -math.inf, math.inf, -math.inf
        if new is None:
            return
        state = OperatorState(core["block_play"], core["block_creep"]).rescaled_to(old, new)
        self._memory["level"] *= (old.x_scale / new.x_scale) ** 2
        # these weights may not have been handed over yet
        learned = HysteresisCreepModel.from_weights(old, old.slope_map @ core["in_use"])
        model = carried_over(learned, new).with_dynamics_of(self.compensator.model)
        self.compensator.change_model(model, self.settings.blend_time_s)
        self._begin(state, resets=False)
        if self._cyclic:
            self._clock["past_span"] = 0.0
        self._note("range", "the thresholds follow the range that was driven")
