"""What computes the drive of a live run: a compensator that stays as it is, or one that learns.

It learns in the thread of the loop: a block takes some microseconds of compiled code, and at 8 kHz no more deadlines
were missed with learning than without, while a second thread of Python would share the interpreter with the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bench.live.board import Board
from bench.live.device import Declared, DeviceError
from piezo_model import (
    Compensator,
    HysteresisCreepModel,
    ModelError,
    ModelStructure,
    SelfLearningCompensator,
    json_file,
)
from piezo_model.deployment import Deployment
from piezo_model.operator_state import OperatorState

Learn = Literal["continuous", "cyclic", "off"]
N, M = 5, 3
"""Orders of a model that is learned from nothing."""
WEIGHTS_S = 0.5
"""Between two looks at the weights for the page."""
SECONDS_A_RATE = (0.1, 1.0, 10.0)
"""1 over the creep rates of a model that is learned from nothing, s."""


@dataclass(frozen=True)
class Plan:
    """What is to compute the drive."""

    file: Path | None
    """A model, or a decision of ``deploy``; the straight line through the ranges where there is none."""
    learn: Learn
    integral_gain: float = 0.0

    def model(self, declared: Declared, sample_time: float) -> HysteresisCreepModel:
        """The model to begin with; DeviceError where it is not of this stage, ModelError where the file holds none."""
        if self.file is None:
            structure = ModelStructure.equidistant(
                N,
                M,
                declared.x_limits,
                declared.y_range,
                tuple(1.0 / s for s in SECONDS_A_RATE),
                sample_time,
                input_unit=declared.input_unit,
                output_unit=declared.output_unit,
            )
            return HysteresisCreepModel.from_weights(structure, structure.straight_line)
        model = (
            Deployment.load(self.file).model
            if json_file.format_of(self.file) == Deployment.FORMAT
            else HysteresisCreepModel.load(self.file)
        )
        s = model.structure
        if abs(s.sample_time / sample_time - 1.0) > 1e-6:
            raise ModelError(
                f"{self.file}: is of a model at {1.0 / s.sample_time:g} Hz; say --rate {1.0 / s.sample_time:g}"
            )
        for what, own, other in (
            ("input", s.input_unit, declared.input_unit),
            ("output", s.output_unit, declared.output_unit),
        ):
            if own and other and own != other:
                raise DeviceError(f"{self.file}: has its {what} in {own} and the stage in {other}")
        return model


class Controller:
    """The compensator of a run."""

    def __init__(self, compensator: Compensator | SelfLearningCompensator, learning: bool, every: int) -> None:
        self.learning = learning
        self._every, self._calls, self._told = every, 0, 0
        self._compensator = compensator
        if isinstance(compensator, SelfLearningCompensator):
            self._learner: SelfLearningCompensator | None = compensator
            self._step: Callable[[float, float], float] = compensator.step
        else:
            self._learner, self._fixed, self._step = None, compensator, self._fixed_step

    @classmethod
    def of(cls, plan: Plan, declared: Declared, sample_time: float) -> Controller:
        """Make it; the actuator is at rest."""
        model = plan.model(declared, sample_time)
        s, every = model.structure, max(1, round(WEIGHTS_S / sample_time))
        state = OperatorState.at_rest(s, (declared.rest - s.x_centre) / s.x_scale)
        if plan.learn == "off":
            return cls(
                Compensator(model, declared.x_limits, declared.rate_limit, state, integral_gain=plan.integral_gain),
                False,
                every,
            )
        learner = SelfLearningCompensator(
            s,
            mode=plan.learn,
            x_limits=declared.x_limits,
            rate_limit=declared.rate_limit,
            integral_gain=plan.integral_gain,
            solver="box_active_set",
            model=model,
            state=state,
            find_centre=plan.file is None,
            follow_range=plan.file is None,
        )
        return cls(learner, True, every)

    def step(self, y_ref: float, y: float) -> float:
        """The drive for a reference, after what the last drive gave; while learning waits, that counts as not
        measured."""
        return self._step(y_ref, y if self.learning or self._learner is None else math.nan)

    def _fixed_step(self, y_ref: float, y: float) -> float:
        self._fixed.correct(y)
        return self._fixed.step(y_ref)

    def tell(self, board: Board) -> None:
        """Show weights and events now and then."""
        self._calls += 1
        if self._calls % self._every:
            return
        board.show_model(self._compensator.model)
        if self._learner is not None:
            board.note(hand_overs=self._learner.counts["hand_overs"])
            new = [event for event in self._learner.log if event.sample >= self._told]
            for event in new:
                board.say(f"{event.what}: {event.message}")
            self._told = max((event.sample + 1 for event in new), default=self._told)
