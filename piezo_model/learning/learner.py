"""The learner of a self-learning compensator, and what it does after a block with events: it writes the log, calls
solvers outside the core, and adapts the ranges. All else is the core's (``core/learner.h``)."""

import math
from collections import deque
from typing import Any

import numpy as np

import solvers
from piezo_model.compensator import Compensator
from piezo_model.core import State, Stateful, bindings
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning.driven_range import PIECE_S, DrivenRange, carried_over
from piezo_model.learning.events import MESSAGES, BlockEvent, Event
from piezo_model.learning.settings import (
    CHECKPOINT_S,
    CLOCK,
    MEMORY,
    MIN_SLOPE,
    LearningSettings,
    learner_numbers,
    write_settings,
)
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import full_gram, write_slope_regressors
from piezo_model.solving import STEPPED, solved
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

LOG_LENGTH = 1000
"""Number of events kept."""


class Learner(Stateful):
    """Learns the weights of a compensator, which nothing else drives or changes from then on.

    Attributes are those of :class:`piezo_model.self_learning.SelfLearningCompensator`.
    """

    def __init__(self, settings: LearningSettings, compensator: Compensator) -> None:
        self.settings, self._compensator, self._cyclic = settings, compensator, settings.mode == "cyclic"
        self.log: deque[Event] = deque(maxlen=LOG_LENGTH)
        self.problem: IdentificationProblem | None = None
        self._block, numbers = learner_numbers(self.structure, settings)
        """Samples of a block."""
        prefilter = compensator.prefilter
        sizes = *self.structure.shape, prefilter.modes, prefilter.ring, self._block, 1, numbers["mode"]
        self._core = State(bindings.learner_bytes(*sizes), lambda memory: bindings.learner_setup(memory, *sizes))
        write_settings(numbers, self._core["settings"])
        self._core["noise_gains"][:] = prefilter.noise_gains
        write_slope_regressors(self._core, self.structure)
        self._driven = DrivenRange() if self._cyclic else DrivenRange(round(PIECE_S / CHECKPOINT_S))
        compensator.set_blend_time(settings.blend_time_s)
        self._begin(compensator.state, resets=True)

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        return self._compensator.model

    @property
    def learned_weights(self) -> Vector:
        """The weights (d,) of the last hand-over; the drive takes them over a block later."""
        return self.structure.slope_map @ self._core["in_use"]

    @property
    def structure(self) -> ModelStructure:
        """The structure of the model in use."""
        return self._compensator.model.structure

    @property
    def samples(self) -> int:
        """Samples observed so far."""
        return int(self._core.as_int64("samples")[0])

    def _begin(self, state: OperatorState, resets: bool) -> None:
        """Begin to learn from the compensator's model and these states of the operators."""
        self._core["in_use"][:] = self.structure.slopes_of(self.model.weights)
        bindings.learner_begin(self._core.block, self._compensator.block, state.play, state.creep, resets)

    @property
    def _memory(self) -> np.void:
        """The core's ``LearnerMemory``."""
        return self._core.record("memory", MEMORY)

    @property
    def _clock(self) -> np.void:
        """The core's ``LearnerClock``."""
        return self._core.record("clock", CLOCK)

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
        self.log.append(Event(self.samples, what, message, old, new, int(self._clock["learning_since"])))

    def _gathered(self) -> IdentificationProblem:
        """The problem of a cycle's data, which the core has in slopes."""
        core, s = self._core, self.structure
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
        core, s = self._core, self.structure
        if self._cyclic:
            self.problem = self._gathered()
            if self.settings.solver == STEPPED:
                return
        P, q, lower = core["P"].reshape(s.d, s.d).copy(), core["q"].copy(), core["lower"].copy()
        c = 0.5 * float(full_gram(core["data" if self._cyclic else "gram"], s)[-1, -1])
        program = solvers.Problem(P, q, lb=lower, ub=np.full(q.size, np.inf))
        try:
            answer = solved(
                self.settings.solver, self.settings.solver_options, program, np.maximum(core["start"], lower), c
            )
        except Exception as error:  # no exception of a library may stop the compensator
            bindings.learner_refuse(core.block)
            self._note("refused", f"the solver {self.settings.solver} failed: {error}")
            return
        if self._cyclic:
            core["answer"][:] = answer
        elif np.all(np.isfinite(answer)):
            core["candidate"][:] = np.maximum(answer, lower)

    def _adapt_range(self) -> None:
        """Change to other ranges if the drive or the output needs them."""
        core, old = self._core, self.structure
        span = core["covered"] if self._cyclic else self._memory["span"]
        new = self._driven.observe(span, old) if self.settings.adapt_range and np.all(np.isfinite(span)) else None
        if not self._cyclic:
            span[:] = math.inf, -math.inf, math.inf, -math.inf
        if new is None:
            return
        state = OperatorState(core["block_play"], core["block_creep"]).rescaled_to(old, new)
        self._memory["level"] *= (old.x_scale / new.x_scale) ** 2
        learned = HysteresisCreepModel.from_weights(old, self.learned_weights)  # which may not be handed over yet
        model = carried_over(learned, new).with_dynamics_of(self.model)
        self._compensator.change_model(model, self.settings.blend_time_s)
        self._begin(state, resets=False)
        self._note("range", "the thresholds follow the range that was driven")
