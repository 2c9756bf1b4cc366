"""Continuous operation, the paper's outlook: the data basis is updated, and the weights with it, in real time (``core/continuous.h``)."""

from __future__ import annotations

import math

from piezo_model.compensator import Compensator
from piezo_model.core import State, face
from piezo_model.learning.driven_range import PIECE_S, DrivenRange
from piezo_model.learning.events import RESET, Brought, Log
from piezo_model.learning.learner import Learner
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings

PROXIMAL = 1e-8
"""Share of the mean diagonal with which the solver holds what the data leave open where it is."""
MOST_EXCHANGES = 2
"""Of one sample; at the cap the answer is feasible, and the next sample goes on from it."""
CHECKPOINT_S = 0.5
"""Between states that are noted to be gone back to after a fault of the sensor."""
SAID = {
    Brought.FIRST: ("hand-over", "the first new weights since learning began; further ones are counted only"),
    Brought.SENSOR_FAULT: ("sensor", "the output jumped, froze or left its range; learning waits"),
    Brought.OTHER_SENSOR: ("sensor", "the output is not what it was before the fault; learning begins anew"),
    Brought.NO_OPTIMUM: ("refused", "the data have no optimum; learning begins anew"),
}


class ContinuousLearning(Learner):
    """The continuous learner of a compensator, whose weights it changes.

    The log gets what changes how learning goes on; hand-overs and refusals are counted, and only the first is an event.
    """

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log) -> None:
        s = compensator.model.structure
        forgetting = math.exp(-s.sample_time / settings.memory_s)
        core = State(face.continuous_bytes(*s.shape),
                     lambda block: face.continuous_setup(block, *s.shape, s.middle, MIN_SLOPE, forgetting, PROXIMAL, MOST_EXCHANGES))
        super().__init__(compensator, settings, log, core, face.continuous_observe, face.continuous_drive,
                         DrivenRange(round(PIECE_S / CHECKPOINT_S)))
        interval = s.samples(settings.hand_over_s)
        for name, value in (("reset_lasts", s.samples(settings.reset_s)), ("left", s.samples(settings.reset_s)), ("interval", interval),
                            ("checkpoint", interval * max(1, s.samples(CHECKPOINT_S) // interval)), ("phase", RESET),
                            ("half_window", s.samples(settings.memory_s))):
            core.whole(name)[:] = value
        core["smoothing"][:] = 1.0 / s.samples(1.0)
        compensator.fade_over(settings.fade_s)
        face.continuous_begin_anew(core.block, 0.0)

    def samples_until_change(self) -> int:
        """Samples for which the weights in use cannot change."""
        interval = self.count("interval")
        return interval - self.count("sample") % interval

    def _follow(self, brought: Brought) -> None:
        for one, (what, message) in SAID.items():
            if one in brought:
                self._note(what, message)
        if Brought.SENSOR_FAULT in brought:
            self._driven.interrupt()
        if Brought.LOOK in brought:
            span = self.core["span"].copy()
            self.core["span"][:] = math.inf, -math.inf, math.inf, -math.inf
            scale = self._compensator.model.structure.x_scale
            if self._follow_range(span):
                self.core.whole("has_fallback")[:] = 0
                level = float(self.core["level"][0]) * (scale / self._compensator.model.structure.x_scale) ** 2
                face.continuous_begin_anew(self.core.block, level)
