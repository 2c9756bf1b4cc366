"""Tasks, their outcomes, and what is said of them: how a task ended,
and the accuracy that an answer must reach.

A task is the unit of work of a race: one problem, in one scaling, by one solver in one lane at one setting. The first
columns of its rows identify it.
"""

from __future__ import annotations

import hashlib
import json
import os
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from piezo_model.json_file import decoded
from solvers.protocol import Lane, Matrix, Nanoseconds, Solver, Unsupported, Vector, setting_text
from solvers.registry import Described

if TYPE_CHECKING:  # a child needs tasks and no model
    from piezo_model.identification_problem import Scaling

Row = dict[str, Any]
"""A row of a task: what identifies it, and what was measured."""
Start = Literal["cold", "warm", "line"]
"""Whether a solve starts from nothing, from the optimum of the previous problem, or from the straight line through the
ranges, with which a self-learning compensator begins."""
Timed = Literal["hot", "long", "interleaved", "scheduled"]
"""Whether the calls of a task follow each other directly, do so for many more calls, alternate with those of other
solvers, or follow the clock of a controller."""
Progress = Callable[[str, int, int], None]
"""Reports the progress of long work: the current step, the number of finished steps and the total."""
PAPER = "projected_difference"
"""The paper's method, one step a sample."""
PAPERS_SETTING = '{"steps": 15200}'
"""Its learning phase, with steps of half the stability limit."""
LONGEST = 500
"""Largest number of characters of what a solver says."""
MOST = 2**53
"""Largest number of iterations that a solver reports."""


def silent(what: str, done: int, total: int) -> None:
    """Report no progress."""


class RaceError(ValueError):
    """A race cannot be run as specified; the message is one sentence with the reason."""


class Tier(StrEnum):
    """The accuracy that an answer must reach, the same for all solvers."""

    DEFAULT = "default"
    """The library's own settings."""
    LOW = "low"
    """Relative cost gap 1e-3."""
    MID = "mid"
    """Relative cost gap 1e-6."""
    HIGH = "high"
    """Relative cost gap 1e-9."""
    EXACT = "exact"
    """Relative cost gap 1e-12."""
    STAGE = "stage"
    """The stage does not notice: on unseen data the error of the model exceeds that of the exact optimum by at most a
    tenth of the sensor noise."""


class Status(StrEnum):
    """How a task ended. A faulty adapter is never reported as a failing solver."""

    ANSWERED = "answered"
    """There is an answer to judge; of a tier, it has the required accuracy."""
    MISSED = "missed"
    """The answer misses the required accuracy, or the solver reports success and gives none."""
    SOLVER_FAILED = "solver_failed"
    """The solver itself reports that it found no answer, and there is none."""
    ADAPTER_FAILED = "adapter_failed"
    """The adapter or the library's interface raised an exception."""
    UNSUPPORTED = "unsupported"
    """The solver cannot take a problem of this form."""
    CRASHED = "crashed"
    """The process died."""
    TIMED_OUT = "timed_out"
    """The process was stopped at its time limit."""
    OUT_OF_MEMORY = "out_of_memory"
    """The process was stopped at its memory limit."""
    TAMPERED = "tampered"
    """Its process touched files of the race or of other processes, or sent an answer that was not requested."""
    NOT_RUN = "not_run"
    """A looser setting of the same solver crashed, was stopped or took too long on this problem."""


FAILURES = (Status.UNSUPPORTED, Status.OUT_OF_MEMORY, Status.ADAPTER_FAILED)
"""Failures that a solver's process reports itself; its parent finds the others."""
Said = Annotated[str, Meta(max_length=LONGEST)]


@dataclass(frozen=True)
class Setting:
    """Settings of a solver, as its ladder has them for a problem whose constant is 1."""

    text: str
    rung: int = -1
    """Position in the ladder, from loose to tight; -1 for none."""
    is_default: bool = True
    """Whether these are the solver's defaults."""
    override: str = ""
    """Settings of the user for a solver, as JSON, used as they are for every problem; "" for none."""


NO_SETTING = Setting(setting_text({}))
"""Setting of a task without solver settings: of the null solver."""


@dataclass(frozen=True)
class Task:
    """A unit of work, by names only, so that it can be sent anywhere and recognised in a resumed race."""

    problem_set: str
    problem: str
    scaling: Scaling
    solver: str
    lane: Lane
    setting: Setting
    repeat: int = 0
    """Number of the repeat; each has fresh processes."""
    start: Start = "cold"
    timed: Timed = "hot"
    d: int = 0
    """Number of variables of the problem."""

    @property
    def subject(self) -> str:
        """What is measured, the same in every run, repeat and way of timing."""
        text = json.dumps(
            [
                self.problem_set,
                self.problem,
                self.scaling,
                self.solver,
                self.lane,
                self.setting.text,
                {},  # as in earlier runs
                self.start,
            ]
        )
        return f"{self.solver}-{self.lane}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    @property
    def key(self) -> str:
        """File name of the task."""
        return f"{self.subject}-{self.timed}-{self.repeat}"

    def columns(self, settings: Mapping[str, Any] | None = None) -> Row:
        """The first columns of every row; ``settings`` are those of the solver."""
        return {
            "task": self.key,
            "problem_set": self.problem_set,
            "problem": self.problem,
            "d": self.d,
            "solver": self.solver,
            "lane": str(self.lane),
            "setting": self.setting.text,
            "rung": self.setting.rung,
            "is_default": self.setting.is_default,
            "scaling": self.scaling,
            "start": self.start,
            "timed": self.timed,
            "repeat": self.repeat,
            "host": os.uname().nodename,
            "settings": setting_text(settings or {}),
        }

    def settings_for(self, cls: type[Solver], c: float) -> dict[str, Any]:
        """The solver's settings for a problem whose constant is c."""
        own = self.setting.override
        return decoded(own, dict[str, Any]) if own else dict(cls.at(self.setting.text, c))


def settings_ladder(solver: Described) -> Sequence[Setting]:
    """The settings of a solver: its defaults, unless they are a rung of its ladder, then the ladder from loose to
    tight."""
    default = setting_text(solver.defaults)
    rungs = [Setting(setting_text(rung), i, setting_text(rung) == default) for i, rung in enumerate(solver.ladder)]
    return rungs if any(rung.is_default for rung in rungs) else [Setting(default), *rungs]


def default_setting(solver: Described) -> Setting:
    """A solver's defaults."""
    return next(setting for setting in settings_ladder(solver) if setting.is_default)


@dataclass
class Outcome:
    """Answer of a child process to a request. Its types limit what a process can answer."""

    failure: Annotated[str, Meta(pattern=rf"^({'|'.join(FAILURES)})?\Z")] = ""
    """A status such as "unsupported", or "" if the request was answered."""
    message: Said = ""
    """Sentence about the failure."""
    found: bool = False
    """Whether the solver reports success."""
    x: Vector | None = None
    y: Vector | None = None
    z: Vector | None = None
    z_box: Vector | None = None
    """Answer and duals by the conventions of qpsolvers."""
    solver_status: Said = ""
    reported_us: Annotated[float, Meta(ge=0.0)] | None = None
    iterations: Annotated[int, Meta(ge=-1, le=MOST)] = -1
    mutated: bool = False
    """Whether the solver changed its input arrays."""
    repeatable: bool = True
    """Whether the same data gave the same bits again."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """The solver's settings."""
    preemptions: Annotated[int, Meta(ge=0, le=2**32)] = 0
    """Number of preemptions while the process was timed."""
    answers: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    """The timed answers. Shape (n, d)."""
    first_call: int = 0
    """The call of the first of them, and below the processor time: both are known to the parent alone."""
    times: Mapping[str, Nanoseconds] = field(default_factory=dict)
    """Raw nanoseconds that the race saves, by name."""
    cpu_ns: float = 0.0
    """Processor time of the timed calls by the parent's clock, where it matters, else 0."""


@dataclass(frozen=True)
class ChildSettings:
    """Limits of a solver's process."""

    time_limit_s: float = 20.0
    """Time limit of each request, everything included."""
    memory_mb: int = 2048
    """Memory that it may allocate once its solver is loaded."""
    hidden: tuple[str, ...] = ()
    """Folders whose files it must not open."""


def attempt(work: Callable[[], Outcome]) -> Outcome:
    """The outcome of work with a solver; an exception is a failure."""
    try:
        return work()
    except Unsupported as error:
        return Outcome("unsupported", one_line(error))
    except MemoryError as error:
        return Outcome("out_of_memory", one_line(f"the memory limit was reached: {error}"))
    except Exception as error:  # a library may raise anything; it is recorded, and the race continues
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{os.path.basename(place.filename)}:{place.lineno}"
        return Outcome("adapter_failed", one_line(f"{type(error).__name__}: {error} ({where})"))


def plain(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as JSON has them."""
    return decoded(setting_text(settings), dict[str, Any])


def one_line(text: object) -> str:
    """What a solver says, as one line of at most LONGEST characters that UTF-8 has."""
    return " ".join(str(text).encode(errors="replace").decode().split())[:LONGEST]
