"""The learner of a compensator: a state of the core, whose weights it changes, and what the core has to tell.

Each sample and each block is the core's business (``core/controller.h``, ``core/learner.h``); it comes back to Python
where there is something to tell: an event for the log, a program for a solver, a range to look at. Cyclic and
continuous operation are settings.
"""

import math
from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np

from piezo_model.compensator import Compensator
from piezo_model.core import State, aligned, bindings
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.json_file import convert
from piezo_model.learning import layout, program
from piezo_model.learning.driven_range import PIECE_S, DrivenRange, carried_over
from piezo_model.learning.events import LEARN, PHASES, RESET, BlockEvent, Event, Log, Phase
from piezo_model.learning.layout import ANSWERED, CLOCK, CONTINUOUS, CYCLIC, MEMORY, STEPS
from piezo_model.learning.settings import EXACT_SOLVERS, MIN_SLOPE, LearningSettings
from piezo_model.learning.solving import STEPPED, step_ratio
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import RegressorArrays
from solvers.arrays import Vector
from solvers.core import padded

MESSAGES = {
    BlockEvent.FIRST: ("hand-over", "the first new weights since learning began; further ones are counted only"),
    BlockEvent.OTHER_SENSOR: ("sensor", "the output is not what it was before the fault; learning begins anew"),
    BlockEvent.NO_OPTIMUM: ("refused", "the data have no optimum; learning begins anew"),
}
"""Of continuous operation, where further hand-overs and refusals are counted only."""


class LearningMemory(TypedDict):
    """What changes while a learner runs."""

    core: np.ndarray
    driven: dict[str, Any]


class Learner:
    """The learner of a compensator, whose weights it changes.

    The log gets what changes how learning goes on. One thread at a time may use it; another one gets a RuntimeError.
    """

    def __init__(self, compensator: Compensator, settings: LearningSettings, log: Log) -> None:
        self._compensator, self._settings, self._log = compensator, settings, log
        s = compensator.model.structure
        self.cyclic = settings.mode == "cyclic"
        self._problem: IdentificationProblem | None = None
        self.block, numbers = (
            self._cyclic_numbers()
            if self.cyclic
            else layout.continuous_numbers(s, settings.hand_over_s, settings.memory_s, settings.reset_s)
        )
        """Samples of a block."""
        if not self.cyclic and settings.solver not in EXACT_SOLVERS:
            numbers["solver"] = ANSWERED
        sizes = *s.shape, self.block, 1, CYCLIC if self.cyclic else CONTINUOUS
        self.core = State(bindings.learner_bytes(*sizes), lambda memory: bindings.learner_setup(memory, *sizes))
        layout.write_settings(numbers, self.core["settings"])
        self.core.whole("delay")[:] = self.block
        RegressorArrays.of(s, "slope").write(self.core)
        self._driven = DrivenRange() if self.cyclic else DrivenRange(round(PIECE_S / layout.CHECKPOINT_S))
        compensator.fade_over(settings.fade_s)
        self.core["in_use"][:] = s.inverse_slope_map @ compensator.model.weights
        bindings.learner_begin(
            self.core.block, compensator.block, compensator.state.play, compensator.state.creep, True
        )

    def _cyclic_numbers(self) -> tuple[int, dict[str, float]]:
        s, settings = self._compensator.model.structure, self._settings
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

    @property
    def problem(self) -> IdentificationProblem | None:
        """Of cyclic operation, what the last building phase has gathered, with what is recalled of the cycles
        before."""
        return self._problem

    @property
    def phase(self) -> Phase:
        """The phase that it is in."""
        return PHASES[self._clock("phase") if self.cyclic else RESET if self.count("left") > 0 else LEARN]

    def count(self, name: str) -> int:
        """A number of the core's memory (``MEMORY`` of `layout`), or "sample"."""
        return int(self.core.whole("samples")[0]) if name == "sample" else int(self.core["memory"][MEMORY.index(name)])

    @property
    def verdicts(self) -> Vector:
        """How often each verdict was given on a sample."""
        return self.core["guard"][-4:]

    def samples_until_change(self) -> int:
        """Samples for which neither the weights in use nor the ranges can change."""
        weights = int(bindings.learner_quiet(self.core.block))
        # Weights are taken over a block after the samples that they come from, and other ranges at once.
        return weights - self.block if self._settings.follow_range and weights > self.block else weights

    def step(self, y_ref: float, y: float | None) -> float:
        """Observe the output of the last drive, None where there was none, then the drive for a reference."""
        with self.core.alone():
            measured = math.nan if y is None else y, y is not None
            x, events = bindings.learner_step(self.core.block, self._compensator.block, y_ref, *measured)
            if events:
                self._follow(BlockEvent(events))  # after which the compensator may be another one
                x, _ = bindings.learner_step(self.core.block, self._compensator.block, y_ref, math.nan, False)
            return float(x)

    def drive(self, y_ref: Vector) -> Vector:
        """Drives (N,) for references, N at most `samples_until_change`; their outputs are to be observed next."""
        with self.core.alone():
            x = np.empty_like(y_ref)
            bindings.learner_drive(self.core.block, self._compensator.block, y_ref, x)
            return x

    def observe(self, x: Vector, y: Vector) -> None:
        """Learn from drive samples and the outputs that they produced."""
        with self.core.alone():
            done, events = 0, np.zeros(1, dtype=np.int64)
            while done < x.size:
                done = bindings.learner_observe(self.core.block, self._compensator.block, y, x, done, events)
                if events[0]:
                    self._follow(BlockEvent(int(events[0])))

    def replay(self, y_ref: Vector, y: Vector) -> Vector:
        """Drive samples (N,), each followed by learning from the output (N,) that it produced."""
        with self.core.alone():
            done, events, x = 0, np.zeros(1, dtype=np.int64), np.empty_like(y_ref)
            while done < x.size:
                done = bindings.learner_replay(self.core.block, self._compensator.block, y, y_ref, x, done, events)
                if events[0]:
                    self._follow(BlockEvent(int(events[0])))
            return x

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
        if self.cyclic:
            self._follow_cycle(events)
        if BlockEvent.LOOK in events or BlockEvent.CYCLE_OVER in events:
            self._follow_range()

    def _follow_cycle(self, events: BlockEvent) -> None:
        errors = (
            float(self.core["clock"][CLOCK.index("error_in_use")]),
            float(self.core["clock"][CLOCK.index("error_found")]),
        )
        if BlockEvent.UNEXCITED in events:
            low, high = self.core["covered"][:2]
            self._note(
                "refused", f"the drive went through {50 * (high - low):.1f} % of its range only, and 2 % are needed"
            )
        elif BlockEvent.NOT_A_NUMBER in events:
            self._note("refused", f"the solver {self._settings.solver} found no finite weights")
        elif BlockEvent.WORSE in events:
            self._note("refused", "the new weights explain the data worse than the old ones", *errors)
        elif BlockEvent.CYCLE_OVER in events:
            self._note("hand-over", "new weights", *errors)

    def _clock(self, name: str) -> int:
        return int(self.core.whole("clock")[CLOCK.index(name)])

    def _note(self, what: Any, message: str, old: float = math.nan, new: float = math.nan) -> None:
        self._log.append(
            Event(self.count("sample"), what, message, old, new, self._clock("learning_since") if self.cyclic else 0)
        )

    def _solve(self) -> None:
        """Have the program of the core solved."""
        core, s = self.core, self._compensator.model.structure
        if self.cyclic:
            self._problem = program.gathered(core, s, self._settings.proximal)
            if self._settings.solver == STEPPED:
                return
            P, q, lower = core["P"].reshape(s.d, s.d).copy(), core["q"].copy(), core["lower"].copy()
            start, c = core["start"].copy(), 0.5 * float(core["data"][0])
        else:
            P, q, lower = np.empty((s.d, s.d)), np.empty(s.d), np.empty(s.d)
            bindings.learner_program(core.block, P, q, lower)
            start, c = np.maximum(core["candidate"], lower), 0.5 * float(core["gram"][s.d * padded(s.d + 1) + s.d])
        try:
            found = program.answer(self._settings, P, q, lower, start, c)
        except Exception as error:  # whatever a library does, the drive goes on
            core["memory"][MEMORY.index("refusals")] += 1
            if self.cyclic:
                bindings.cyclic_enter(core.block, RESET)
            self._note("refused", f"the solver {self._settings.solver} failed: {error}")
            return
        if self.cyclic:
            core["answer"][:] = found
        elif np.all(np.isfinite(found)):
            core["candidate"][:] = np.maximum(found, lower)

    def _follow_range(self) -> None:
        """Go on in other ranges, where those that were driven are others."""
        core, old = self.core, self._compensator.model.structure
        span = core["covered"] if self.cyclic else core["memory"][MEMORY.index("span") :]
        new = self._driven.look(span, old) if self._settings.follow_range and np.all(np.isfinite(span)) else None
        if not self.cyclic:
            span[:] = math.inf, -math.inf, math.inf, -math.inf
        if new is None:
            return
        state = OperatorState(core["block_play"], core["block_creep"]).on(old, new)
        level = core["memory"][MEMORY.index("level")] * (old.x_scale / new.x_scale) ** 2
        # perhaps offered and not yet taken
        learned = HysteresisCreepModel.from_weights(old, old.slope_map @ core["in_use"])
        self._compensator.change_model(carried_over(learned, new), self._settings.fade_s)
        core["in_use"][:] = new.inverse_slope_map @ self._compensator.model.weights
        core["memory"][MEMORY.index("level")] = level
        bindings.learner_begin(core.block, self._compensator.block, state.play, state.creep, False)
        if self.cyclic:
            core["clock"][CLOCK.index("past_share")] = 0.0
        self._note("range", "the thresholds follow the range that was driven")

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, copied."""
        with self.core.alone():
            return {"core": self.core.block.copy(), "driven": self._driven.memory()}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; the compensator has been restored before. ValueError
        says why not."""
        with self.core.alone():
            found = convert(memory, LearningMemory)
            if found["core"].dtype != np.uint8 or found["core"].size != self.core.block.size:
                raise ValueError("the state of the core is that of another structure")
            self._driven.restore(found["driven"])
            bindings.learner_restore(self.core.block, aligned(found["core"]))
            stepping = self.cyclic and self._clock("phase") == LEARN
            self._problem = (
                program.gathered(self.core, self._compensator.model.structure, self._settings.proximal)
                if stepping
                else None
            )
