"""Computes the drive of a live run: a compensator with a fixed model, or one that learns.

Learning runs in the thread of the loop: a block takes microseconds of compiled code and at 8 kHz costs no deadlines,
while a second Python thread would share the interpreter with the loop.
"""

from typing import Any

from bench.live.board import Board
from bench.live.settings import LiveSettings
from piezo_model import Compensator, SelfLearningCompensator


class Controller:
    """The compensator of a run, with its actuator at rest."""

    def __init__(self, settings: LiveSettings) -> None:
        stage, self._next_logged = settings.declared, 0
        drive: dict[str, Any] = {
            "x_limits": stage.x_limits,
            "rate_limit": stage.rate_limit,
            "x_start": stage.rest,
            "integral_gain": settings.integral_gain,
        }
        self._compensator = (
            SelfLearningCompensator(
                settings.model.structure,
                mode=settings.learn,
                solver="box_active_set",
                model=settings.model if settings.identified else None,
                **drive,
            )
            if settings.learn != "off"
            else Compensator(settings.model, **drive)
        )

    def step(self, y_ref: float, y: float) -> float:
        """Return the drive for a reference, given the output that the last drive produced."""
        if isinstance(self._compensator, SelfLearningCompensator):
            return self._compensator.step(y_ref, y)
        self._compensator.correct(y)
        return self._compensator.step(y_ref)

    def show(self, board: Board) -> None:
        """Write new events to the board."""
        if isinstance(self._compensator, SelfLearningCompensator):
            board.set(hand_overs=self._compensator.counts["hand_overs"])
            for event in [event for event in self._compensator.log if event.sample >= self._next_logged]:
                board.log(f"{event.what}: {event.message}")
                self._next_logged = event.sample + 1
