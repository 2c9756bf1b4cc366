"""What computes the drive of a live run: a compensator that stays as it is, or one that learns.

It learns in the thread of the loop: a block takes some microseconds of compiled code, and at 8 kHz no more deadlines
were missed with learning than without, while a second thread of Python would share the interpreter with the loop.
"""

import math

from bench.live.board import Board
from bench.live.task import Task
from piezo_model import Compensator, SelfLearningCompensator
from piezo_model.operator_state import OperatorState


class Controller:
    """The compensator of a run, whose actuator is at rest."""

    def __init__(self, task: Task) -> None:
        s, declared = task.model.structure, task.declared
        state = OperatorState.at_rest(s, (declared.rest - s.x_centre) / s.x_scale)
        self.learning, self._told = task.learn != "off", 0
        self._compensator: Compensator | SelfLearningCompensator
        if task.learn == "off":
            self._compensator = Compensator(
                task.model, declared.x_limits, declared.rate_limit, state, integral_gain=task.integral_gain
            )
        else:
            self._compensator = SelfLearningCompensator(
                s,
                mode=task.learn,
                x_limits=declared.x_limits,
                rate_limit=declared.rate_limit,
                integral_gain=task.integral_gain,
                solver="box_active_set",
                model=task.model if task.identified else None,
                state=state,
            )

    def step(self, y_ref: float, y: float) -> float:
        """The drive for a reference, after what the last drive gave; while learning waits, that counts as not
        measured."""
        if isinstance(self._compensator, SelfLearningCompensator):
            return self._compensator.step(y_ref, y if self.learning else math.nan)
        self._compensator.correct(y)
        return self._compensator.step(y_ref)

    def tell(self, board: Board) -> None:
        """Show weights and events."""
        board.show_model(self._compensator.model)
        if isinstance(self._compensator, SelfLearningCompensator):
            board.note(hand_overs=self._compensator.counts["hand_overs"])
            new = [event for event in self._compensator.log if event.sample >= self._told]
            for event in new:
                board.say(f"{event.what}: {event.message}")
            self._told = max((event.sample + 1 for event in new), default=self._told)
