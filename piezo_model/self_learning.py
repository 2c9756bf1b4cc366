"""The self-learning compensator: the signal flow of the paper's Fig. 1.

    y_ref → compensator → x → actuator → y → data basis → solver → weights → inverse → compensator

In cyclic operation a synchronous Moore machine builds the data basis, learns, and hands over; in continuous operation
(the paper's outlook) it takes the exact optimum of a forgetting data basis at every interval. The two are settings of
one learner. The core handles samples and blocks (``core/controller.h``, ``core/learner.h``), and Python the events of
blocks (`piezo_model.learning.learner`). In both the drive is finite and inside its limits for any input, and learning
pauses at a sensor fault and resumes by itself.
"""

import copy
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model import checks, json_file
from piezo_model.compensator import Compensator, CompensatorState, blend_factor
from piezo_model.core import bindings, exclusively
from piezo_model.learning.driven_range import DrivenRange
from piezo_model.learning.events import BlockEvent, Event, Phase, Verdict
from piezo_model.learning.learner import LOG_LENGTH, Learner
from piezo_model.learning.learner_file import read_learner, write_learner
from piezo_model.learning.settings import LearningSettings, Mode
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import OperatorState
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector, reals


class LearnerState(TypedDict):
    """State of the learner."""

    core: np.ndarray
    driven: DrivenRange


class SavedState(TypedDict):
    """State of a self-learning compensator."""

    compensator: CompensatorState
    learning: LearnerState
    last_x: json_file.Number | None
    log: list[Event]


class SelfLearningCompensator(Learner):
    """A compensator that identifies its own model while it runs.

    One thread at a time may use it; another one gets a RuntimeError.

    Parameters
    ----------
    structure : ModelStructure
    reset_s, build_s, learn_s : float
        Lengths of the phases of cyclic operation in s. In both modes the sensor must be good for ``reset_s`` after a
        fault.
    solver : str
        Any registered solver. In cyclic operation the paper's ``projected_difference`` takes one step a sample; in
        continuous operation the default means the exact solver, at every interval.
    x_limits : pair of float, optional
        Limits of the drive in the input unit; the structure's range by default.
    mode : "cyclic" or "continuous"
    forgetting_time_s : float
        Time constant of forgetting in continuous mode.
    hand_over_s : float
        Interval between hand-overs in continuous mode.
    blend_time_s : float
        Time constant with which the transfer bump of a hand-over decays.
    rate_limit : float, optional
        Largest change of the drive per second.
    solve_delay_samples : int
        In cyclic operation, the samples after which the answer of any other solver is due; 1 by default.
    estimate_offset : bool, optional
        Whether to add a constant term to a structure without one, since the centre of the actuator's loop is not known
        beforehand. True by default if the structure has none and no model is given.
    adapt_range : bool, optional
        Whether the thresholds follow the range that is driven (`driven_range`), which needs a constant term. True by
        default if no model is given.
    proximal : float
        Strength of the pull towards the weights in use, as of ``IdentificationProblem``. The default is about the
        variance of a sensor's noise: directions that the data excite less than that stay unchanged.
    integral_gain : float
        Gain of the integral action in 1/s, as of ``Compensator``; it ignores samples that the sensor guard rejects.
    solver_options : mapping, optional
        Lane and settings of the solver as of :func:`piezo_model.learning.solving.solved`.
    model : HysteresisCreepModel, optional
        Initial model; the straight line through the ranges by default.
    state : OperatorState, optional
        States of the operators before the first sample; by default those of a stage that has settled at ``x_start``.
    x_start : float, optional
        Where the stage is before the first sample, as of ``Compensator``.

    Attributes
    ----------
    settings : LearningSettings
        The parameters above.
    log : deque of Event
        The last thousand hand-overs, refusals, sensor faults and changes of ranges.
    problem : IdentificationProblem or None
        Program of the last building phase, with the share of the cycles before; None in continuous mode.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("relay_preisach", sample_time=1e-3)
    >>> structure = ModelStructure.equidistant(n=5, m=3, x_range=plant.x_range, y_range=plant.y_range,
    ...                                        creep_rates=(10.0, 1.0), sample_time=1e-3)
    >>> learner = SelfLearningCompensator(structure, reset_s=0.1, build_s=2.0, learn_s=0.1, solver="box_active_set",
    ...                                   x_limits=plant.x_range, solve_delay_samples=1)
    >>> x = learner.step(0.0, float("nan"))  # nothing measured yet
    """

    def __init__(
        self,
        structure: ModelStructure,
        reset_s: float = 0.1,
        build_s: float = 8.0,
        learn_s: float = 1.9,
        solver: str = "projected_difference",
        x_limits: tuple[float, float] | None = None,
        mode: Mode = "cyclic",
        *,
        forgetting_time_s: float = 2.0,
        hand_over_s: float = 0.01,
        blend_time_s: float = 0.002,
        rate_limit: float | None = None,
        solve_delay_samples: int = 1,
        estimate_offset: bool | None = None,
        adapt_range: bool | None = None,
        proximal: float = 1e-6,
        integral_gain: float = 0.0,
        solver_options: Mapping[str, Any] | None = None,
        model: HysteresisCreepModel | None = None,
        state: OperatorState | None = None,
        x_start: float | None = None,
    ) -> None:
        checks.instance(ModelStructure, structure=structure)
        checks.require(lambda model: model is None or isinstance(model, HysteresisCreepModel), "a model", model=model)
        adds_offset = model is None and not structure.offset if estimate_offset is None else estimate_offset
        adapts = model is None and (structure.offset or adds_offset) if adapt_range is None else adapt_range
        settings = LearningSettings(
            reset_s,
            build_s,
            learn_s,
            solver,
            structure.x_range if x_limits is None else x_limits,
            mode,
            forgetting_time_s,
            hand_over_s,
            blend_time_s,
            rate_limit,
            solve_delay_samples,
            adds_offset,
            adapts,
            proximal,
            integral_gain,
            solver_options,
        )
        model = HysteresisCreepModel.from_weights(structure, structure.straight_line) if model is None else model
        checks.check(model.structure == structure, "the model has another structure than the one given")
        if adds_offset and not structure.offset:
            model = replace(model, structure=replace(structure, offset=True))
        super().__init__(
            settings,
            Compensator(
                model,
                settings.x_limits,
                settings.rate_limit,
                state,
                x_start=x_start,
                integral_gain=settings.integral_gain,
            ),
        )
        self._last_x: float | None = None

    @property
    @exclusively
    def compensator(self) -> Compensator:
        """The compensator as it is now, a copy: only the learner changes its own, which it learns from."""
        return copy.deepcopy(self._compensator)

    @property
    def mode(self) -> Mode:
        """Cyclic or continuous operation."""
        return self.settings.mode

    @property
    def phase(self) -> Phase:
        """The current phase."""
        if self._cyclic:
            return list(Phase)[self._clock["phase"]]
        return Phase.RESET if self._memory["reset_remaining"] > 0 else Phase.LEARN

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of verdicts on samples, of hand-overs, of refusals of new weights, and of those refusals because the
        output falls as the input rises."""
        return {
            **{
                verdict.name.lower(): int(count)
                for verdict, count in zip(Verdict, self._core["guard"][-len(Verdict) :], strict=True)
            },
            **{name: int(self._memory[name]) for name in ("hand_overs", "refusals", "reversed")},
        }

    def samples_until_change(self) -> int:
        """Number of samples whose drives can be computed at once, since nothing that they depend on can change."""
        return int(bindings.learner_quiet(self._core.block, self._compensator.block, self.settings.adapt_range))

    def step(self, y_ref: float, y_measured_before: float) -> float:
        """Process one sample.

        Parameters
        ----------
        y_ref : float
            Reference in the output unit.
        y_measured_before : float
            Output that the drive of the last call produced; NaN if there is none.

        Returns
        -------
        float
            Drive in the input unit.
        """
        with self._core.exclusive():
            x, events = bindings.learner_step(
                self._core.block, self._compensator.block, y_ref, y_measured_before, self._last_x is not None
            )
            if events:
                self._follow(BlockEvent(events))  # may replace the compensator's state
                x, _ = bindings.learner_step(self._core.block, self._compensator.block, y_ref, np.nan, False)
        self._last_x = float(x)
        return self._last_x

    def run(self, y_ref: ArrayLike, actuator: Callable[[Vector], Vector]) -> tuple[Vector, Vector]:
        """Close the loop over an actuator, a function from drive samples to output samples that keeps its state.

        Returns the same bits as ``step`` sample by sample, in chunks that end where the weights may change. The output
        of a preceding ``step`` counts as missing, and so do the outputs of a chunk in which the actuator raises an
        exception.

        Returns
        -------
        x, y : array (N,)
            Drive and measured output.
        """
        (y_ref,) = checks.vectors(y_ref=y_ref)
        checks.require(callable, "a function of drives", actuator=actuator)
        if self._last_x is not None:
            self.observe([self._last_x], [np.nan])
        x, y = np.empty(y_ref.size), np.full(y_ref.size, np.nan)
        done = 0
        while done < y_ref.size:
            chunk = slice(done, min(done + self.samples_until_change(), y_ref.size))
            x[chunk] = self.drive(y_ref[chunk])
            try:
                y[chunk] = reals("the output of the actuator", actuator(x[chunk]))
            finally:
                self.observe(x[chunk], y[chunk])
            done = chunk.stop
        return x, y

    @exclusively
    def drive(self, y_ref: ArrayLike) -> Vector:
        """Drives (N,) for references (N,), at most `samples_until_change` of them, once the last drive is observed;
        ``observe`` must follow."""
        (y_ref,) = checks.vectors(y_ref=y_ref)
        checks.check(
            self._last_x is None and y_ref.size <= self.samples_until_change(),
            "drive takes at most samples_until_change() references, and none before the last drive is observed",
        )
        x = np.empty_like(y_ref)
        bindings.learner_drive(self._core.block, self._compensator.block, y_ref, x)
        return x

    def observe(self, x: ArrayLike, y: ArrayLike) -> None:
        """Learn from drive samples (N,) of the compensator and their outputs (N,), NaN if unknown."""
        x, y = checks.vectors(x=x, y=y)
        checks.finite_arrays(x=x)
        self._last_x = None
        self._until_done(
            x.size,
            lambda done, events: bindings.learner_observe(
                self._core.block, self._compensator.block, y, x, done, events
            ),
        )

    def replay(self, y_ref: ArrayLike, y_measured_before: ArrayLike) -> Vector:
        """Return the drives (N,) of ``step`` for arrays (N,) of its arguments, to the last bit, in compiled code."""
        y_ref, y = checks.vectors(y_ref=y_ref, y_measured_before=y_measured_before)
        x = np.empty_like(y_ref)
        self._until_done(
            x.size,
            lambda done, events: bindings.learner_replay(
                self._core.block, self._compensator.block, y, y_ref, x, done, events
            ),
            self._last_x is None,
        )
        self._last_x = float(x[-1]) if x.size else self._last_x
        return x

    @exclusively
    def get_state(self) -> dict[str, Any]:
        """A copy of the whole state, without the settings."""
        return {
            "compensator": self._compensator.get_state(),
            "learning": {"core": self._core.block.copy(), "driven": asdict(self._driven)},
            "last_x": self._last_x,
            "log": [asdict(event) for event in self.log],
        }

    @exclusively
    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue, to the last bit, from the :meth:`get_state` of a compensator of the same settings."""
        vars(self).update(vars(self._resumed(self.settings, state)))

    def save(self, path: str | Path) -> None:
        """Write settings and state as JSON, at any time; the file is replaced as a whole."""
        write_learner(path, asdict(self.settings), self.get_state())

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Continue, to the last bit, from a file of :meth:`save`; ModelError names what is wrong with it."""
        fields, state = read_learner(path)
        with checks.refusing(ModelError, f"{path}: does not hold a whole compensator: "):
            settings = json_file.convert(fields, LearningSettings)
            named = {**(settings.solver_options or {}), "lane": "", "setting": ""}
            # a library could take a text for the name of a file to write
            if texts := [name for name, value in named.items() if value and isinstance(value, str | list | dict)]:
                raise ValueError(f"the solver's option {texts[0]} is no number, and a file sets only numbers")
            return cls._resumed(settings, state)

    @classmethod
    def _resumed(cls, settings: LearningSettings, state: Mapping[str, Any]) -> Self:
        """A compensator of these settings that continues from a state."""
        saved = json_file.convert(state, SavedState)
        model = HysteresisCreepModel.from_file(saved["compensator"]["model"])
        learner = cls(model.structure, **vars(settings), model=model)
        checks.check(learner.structure == model.structure, "the model has no constant term, which the settings ask for")
        checks.check(
            saved["compensator"]["decay"] == blend_factor(model.structure, settings.blend_time_s),
            "the state has another blend time than the settings",
        )
        learner._compensator.restore(saved["compensator"])
        learner._core.restore(saved["learning"]["core"], bindings.learner_restore)
        learner._core["noise_gains"][:] = learner._compensator.prefilter.noise_gains
        learner._driven = replace(saved["learning"]["driven"], per_piece=learner._driven.per_piece)
        learner.log, learner._last_x = deque(saved["log"], LOG_LENGTH), saved["last_x"]
        learner.problem = learner._gathered() if learner._cyclic and learner.phase is Phase.LEARN else None
        return learner

    @exclusively
    def _until_done(self, samples: int, call: Callable[[int, NDArray[np.int64]], int], observed: bool = False) -> None:
        """Process samples by a function of the core that takes the number of the first one, stops at events, and
        returns the number of samples done. A sample that is ``observed``, or had events, is to be driven only."""
        done, events = 0, np.full(1, observed, dtype=np.int64)
        while done < samples:
            done = call(done, events)
            if events[0]:
                self._follow(BlockEvent(int(events[0])))
