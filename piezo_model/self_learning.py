"""The self-learning compensator: the signal flow of the paper's Fig. 1.

    y_ref → compensator → x → actuator → y → data basis → solver → weights → inverse → compensator

In cyclic operation a synchronous Moore machine builds the data basis, learns, and hands over; in
continuous operation (the paper's outlook) the exact optimum of a forgetting data basis follows every interval. The two
are settings of one learner (`learning.learner`). Both leave a compensator that works when the sensor does not: the
drive is finite and inside its limits whatever comes in, learning pauses at a fault and goes on by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks, compensator_file, json_file
from piezo_model.compensator import Compensator, CompensatorMemory
from piezo_model.compensator_file import LearnerFile
from piezo_model.core import bindings
from piezo_model.deployment import Deployment
from piezo_model.json_file import Number
from piezo_model.learning.driven_range import DrivenRange, RangeMemory
from piezo_model.learning.events import LEARN, PHASES, RESET, BlockEvent, Event, Phase, Verdict
from piezo_model.learning.learner import Learner
from piezo_model.learning.program import gathered
from piezo_model.learning.settings import LearningSettings, Mode
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import OperatorState
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector


class LearnerMemory(TypedDict):
    """What changes while the learner runs."""

    core: np.ndarray
    driven: RangeMemory


class Memory(TypedDict):
    """What changes while a compensator runs."""

    compensator: CompensatorMemory
    learning: LearnerMemory
    last_x: Number | None
    log: list[Event]


class SelfLearningCompensator(Learner):
    """A compensator that identifies its own model while it runs.

    One thread at a time may use it; another one gets a RuntimeError.

    Parameters
    ----------
    structure : ModelStructure
    reset_s, build_s, learn_s : float
        Lengths of the phases of cyclic operation in s; after a fault the sensor must be good for ``reset_s`` in both
        modes.
    solver : str
        Any registered solver. In cyclic operation the paper's ``projected_difference`` takes one step a sample; in
        continuous operation the default means the exact solver, at every interval.
    x_limits : pair of float, optional
        Limits of the drive in the input unit; the structure's range by default.
    mode : "cyclic" or "continuous"
    memory_s : float
        Time constant of forgetting in continuous mode.
    hand_over_s : float
        Interval between hand-overs in continuous mode.
    fade_s : float
        Time constant with which the bump of a hand-over decays.
    rate_limit : float, optional
        Largest change of the drive per second.
    samples_to_solve : int
        Of cyclic operation, the samples that a solver has which is not one of steps; 1 by default.
    find_centre : bool, optional
        Whether a structure without a constant term gets one, since no range given beforehand has the centre of the
        actuator's loop in its middle. By default where the structure has none and no model is given.
    follow_range : bool, optional
        Whether the thresholds follow the range that is really driven (`driven_range`), which takes a structure with a
        constant. By default where no model is given.
    proximal : float
        Strength of the pull towards the weights in use, as of ``IdentificationProblem``. The default is of the order of
        the variance of a sensor's noise: directions that are weaker than that in the data stay as they are.
    integral_gain : float
        Of the integral action, in 1/s, as of ``Compensator``; samples that the guard of the sensor does not trust are
        left out.
    solver_options : mapping, optional
        Lane, setting and more settings of the solver as of :func:`piezo_model.learning.solving.solved`.
    model : HysteresisCreepModel, optional
        What it starts with; the straight line through the ranges by default.
    state : OperatorState, optional
        What the actuator has seen before.

    Attributes
    ----------
    compensator : Compensator
        Whose weights it changes.
    settings : LearningSettings
        The parameters above.
    log : deque of Event
        What changes how learning goes on, the last thousand events.
    problem : IdentificationProblem or None
        What the last building phase has gathered, with what is recalled of the cycles before; None in continuous mode.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("relay_preisach", sample_time=1e-3)
    >>> structure = ModelStructure.equidistant(n=5, m=3, x_range=plant.x_range, y_range=plant.y_range,
    ...                                        creep_rates=(10.0, 1.0), sample_time=1e-3)
    >>> learner = SelfLearningCompensator(structure, reset_s=0.1, build_s=2.0, learn_s=0.1, solver="box_active_set",
    ...                                   x_limits=plant.x_range, samples_to_solve=1)
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
        memory_s: float = 2.0,
        hand_over_s: float = 0.01,
        fade_s: float = 0.002,
        rate_limit: float | None = None,
        samples_to_solve: int = 1,
        find_centre: bool | None = None,
        follow_range: bool | None = None,
        proximal: float = 1e-6,
        integral_gain: float = 0.0,
        solver_options: Mapping[str, Any] | None = None,
        model: HysteresisCreepModel | None = None,
        state: OperatorState | None = None,
    ) -> None:
        if find_centre is None:
            find_centre = model is None and not structure.offset
        if follow_range is None:
            follow_range = model is None and (structure.offset or find_centre)
        settings = LearningSettings(
            reset_s,
            build_s,
            learn_s,
            solver,
            structure.x_range if x_limits is None else x_limits,
            mode,
            memory_s,
            hand_over_s,
            fade_s,
            rate_limit,
            samples_to_solve,
            find_centre,
            follow_range,
            proximal,
            integral_gain,
            solver_options,
        )
        if model is None:
            model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
        elif model.structure != structure:
            raise ValueError("the model has another structure than the one given")
        if find_centre and not structure.offset:
            model = replace(model, structure=replace(structure, offset=True))  # with a constant, which is zero so far
        super().__init__(
            Compensator(model, settings.x_limits, rate_limit, state, integral_gain=integral_gain), settings
        )
        self._last_x: float | None = None

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        return self.compensator.model

    @property
    def learned_weights(self) -> Vector:
        """The weights (d,) that were learned last; the drive takes them over a block later."""
        return self.structure.slope_map @ self._core["in_use"]

    @property
    def structure(self) -> ModelStructure:
        """The structure of the model in use."""
        return self.compensator.model.structure

    @property
    def mode(self) -> Mode:
        """Cyclic or continuous operation."""
        return self.settings.mode

    @property
    def phase(self) -> Phase:
        """The phase of the machine."""
        return PHASES[self._clock("phase") if self._cyclic else RESET if self._count("left") > 0 else LEARN]

    @property
    def samples(self) -> int:
        """Samples observed so far."""
        return int(self._core.whole("samples")[0])

    @property
    def counts(self) -> dict[str, int]:
        """How often what happened: verdicts on samples, hand-overs, refusals of new weights."""
        verdicts = self._core["guard"][-len(Verdict) :]
        return {
            **{verdict.name.lower(): int(count) for verdict, count in zip(Verdict, verdicts, strict=True)},
            "hand_overs": self._count("hand_overs"),
            "refusals": self._count("refusals"),
        }

    def samples_until_change(self) -> int:
        """Samples for which neither the weights in use nor the ranges nor the integral action can change, so that their
        drive can be computed in one go."""
        if self.settings.integral_gain > 0.0:
            return 1
        weights = int(bindings.learner_quiet(self._core.block))
        # Weights are taken over a block after the samples that they come from, and other ranges at once.
        return weights - self._block if self.settings.follow_range and weights > self._block else weights

    def step(self, y_ref: float, y_measured_before: float) -> float:
        """One sample.

        Parameters
        ----------
        y_ref : float
            Reference in the output unit.
        y_measured_before : float
            The output that the drive returned by the last call has produced; NaN where there is none.

        Returns
        -------
        float
            Drive in the input unit.
        """
        observes = self._last_x is not None
        with self._core.alone():
            x, events = bindings.learner_step(
                self._core.block, self.compensator.block, float(y_ref), float(y_measured_before), observes
            )
            if events:
                self._follow(BlockEvent(events))  # after which the compensator may have another state
                x, _ = bindings.learner_step(self._core.block, self.compensator.block, float(y_ref), np.nan, False)
        self._last_x = float(x)
        return self._last_x

    def run(self, y_ref: ArrayLike, actuator: Callable[[Vector], Vector]) -> tuple[Vector, Vector]:
        """Close the loop over an actuator, a function from drive samples to output samples that remembers its state.

        The same, to the last bit, as ``step`` sample by sample, in chunks that end where the weights may change. The
        output of a ``step`` before it was never told, so that sample is taken for missing.

        Returns
        -------
        x, y : array (N,)
            Drive and measured output.
        """
        y_ref = np.ascontiguousarray(y_ref, dtype=np.float64)
        self._observe_last(np.nan)
        x, y = np.empty(y_ref.size), np.empty(y_ref.size)
        done = 0
        while done < y_ref.size:
            chunk = slice(done, min(done + self.samples_until_change(), y_ref.size))
            x[chunk] = self.drive(y_ref[chunk])
            y[chunk] = actuator(x[chunk])
            self.observe(x[chunk], y[chunk])
            done = chunk.stop
        return x, y

    def drive(self, y_ref: ArrayLike) -> Vector:
        """Drives (N,) for references (N,), at most `samples_until_change` of them; their outputs are to be observed
        next."""
        y_ref = np.ascontiguousarray(y_ref, dtype=np.float64)
        x = np.empty_like(y_ref)
        with self._core.alone():
            bindings.learner_drive(self._core.block, self.compensator.block, y_ref, x)
        return x

    def observe(self, x: ArrayLike, y: ArrayLike) -> None:
        """Learn from drive samples (N,) of the compensator and the outputs (N,) that they produced, NaN where
        unknown."""
        x, y = checks.vectors(x=x, y=y)
        checks.finite_arrays(x=x)
        self._until_done(
            x.size,
            lambda done, events: bindings.learner_observe(self._core.block, self.compensator.block, y, x, done, events),
        )

    def _observe_last(self, y: float) -> None:
        """Observe the output that the drive of the last ``step`` has produced, if it is not known yet."""
        if self._last_x is not None:
            self.observe([self._last_x], [y])
            self._last_x = None

    def replay(self, y_ref: ArrayLike, y_measured_before: ArrayLike) -> Vector:
        """Return what ``step`` returns for each pair of samples, to the last bit, in compiled code from end to end.

        Parameters
        ----------
        y_ref, y_measured_before : array (N,)
            As of :meth:`step`, one after the other.

        Returns
        -------
        array (N,)
            Drive.
        """
        y_ref, y = checks.vectors(y_ref=y_ref, y_measured_before=y_measured_before)
        x = np.empty_like(y_ref)
        if x.size:
            self._observe_last(float(y[0]))
            # The output of the last drive comes with the next call.
            before, after, x_before = y_ref[:-1], y[1:], x[:-1]
            self._until_done(
                x.size - 1,
                lambda done, events: bindings.learner_replay(
                    self._core.block, self.compensator.block, after, before, x_before, done, events
                ),
            )
            x[-1] = self.step(float(y_ref[-1]), np.nan)
        return x

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, copied; settings are not part of it."""
        with self._core.alone():
            return {
                "compensator": self.compensator.memory(),
                "learning": {"core": self._core.block.copy(), "driven": self._driven.memory()},
                "last_x": self._last_x,
                "log": [asdict(event) for event in self.log],
            }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from the :meth:`memory` of a compensator of the same settings."""
        found = json_file.convert(memory, Memory)
        with self._core.alone():
            self.compensator.restore(found["compensator"])
            self._core.restore(found["learning"]["core"], bindings.learner_restore)
            self._driven = DrivenRange(self._driven.looks, **found["learning"]["driven"])
            stepping = self._cyclic and self.phase is Phase.LEARN
            self.problem = gathered(self._core, self.structure, self.settings.proximal) if stepping else None
            self._last_x = found["last_x"]
            self.log.clear()
            self.log.extend(found["log"])

    def save(self, path: str | Path) -> None:
        """Write everything as JSON, in the middle of a cycle too; the file is there whole or not at all."""
        compensator_file.write(path, asdict(self.settings), self.memory())

    @classmethod
    def load(cls, path: str | Path, **options: Any) -> SelfLearningCompensator:
        """Go on, to the last bit, from a file of :meth:`save`, or start from one of ``piezobench deploy``.

        Parameters
        ----------
        path : str or Path
        **options
            Where it starts afresh: any other parameter of the class, or one that is to differ from the file.

        Raises
        ------
        ModelError
            The file is neither, or damaged; the message is one sentence that names it.
        """
        if json_file.format_of(path) == LearnerFile.FORMAT:
            if options:
                raise ValueError(
                    f"{path} goes on with the settings that it was saved with, so {sorted(options)[0]} must not be "
                    f"given"
                )
            return cls._resumed(path)
        found = Deployment.load(path)
        chosen: dict[str, Any] = {
            "solver": found.solver,
            "x_limits": found.x_limits,
            "mode": found.mode,
            "model": found.model,
            "solver_options": found.options,
        }
        try:
            return cls(found.model.structure, **{**chosen, **options})
        except ValueError as error:
            if options:  # which may be what is wrong
                raise
            raise ModelError(f"{path}: {json_file.brief(error)}") from None

    @classmethod
    def _resumed(cls, path: str | Path) -> SelfLearningCompensator:
        fields, memory = compensator_file.read(path)
        try:
            found = json_file.convert(memory, Memory)
            settings = json_file.convert(fields, LearningSettings)
            model = HysteresisCreepModel.from_file(found["compensator"]["model"])
            learner = cls(model.structure, **asdict(settings), model=model)
            learner.restore(memory)
        except ValueError as error:
            raise ModelError(f"{path}: does not hold a whole compensator: {json_file.brief(error)}") from None
        return learner
