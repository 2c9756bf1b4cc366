"""A task, what a solver's process is asked for it, and what comes back.

A task is the unit of work of a race: one problem, in one scaling, by one solver in one lane at one setting. Its rows
begin by naming it.
"""

from __future__ import annotations

import hashlib
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from solvers.arrays import Vector
from solvers.protocol import Lane, Nanoseconds, Solver, Tier, Unsupported, setting_text
from solvers.registry import Described

if TYPE_CHECKING:  # a child needs tasks and no model
    from piezo_model.identification_problem import Scaling

Row = dict[str, Any]
"""What is kept of a task; every kind of race adds its own columns to those that say who did what."""
Start = Literal["cold", "warm"]
"""Whether a solve begins from nothing or from the optimum of the problem before."""
NO_RUNG = -1
"""In the place of a rung: a setting that is not in the ladder."""


@dataclass(frozen=True)
class Setting:
    """What a solver is asked for, by what its ladder has for a problem whose constant is 1."""

    text: str
    rung: int = NO_RUNG
    """Its place in the ladder, from loose to tight."""
    is_default: bool = True
    """Whether it is the solver's defaults."""
    rung_text: str = ""
    """Of a limit of iterations, the setting that it is put on; the limit itself is in `Task.more`."""


NO_SETTING = Setting(setting_text({}))
"""Of whatever is asked for nothing, neither on top nor always: the solver that does nothing, and a batch."""


@dataclass(frozen=True)
class Task:
    """What is run, by name only, so that a task can be sent anywhere and found again."""

    problem_set: str
    problem: str
    scaling: Scaling
    solver: str
    lane: Lane
    setting: Setting
    more: Mapping[str, Any] = field(default_factory=dict)
    """Solver settings on top, such as the number of steps."""
    repeat: int = 0
    """Which of several runs of the same, each in a fresh process."""
    start: Start = "cold"
    d: int = 0
    """Number of variables of the problem."""
    basis: Mapping[Tier, str] = field(default_factory=dict)
    """The tiers that the setting stands for, and on what grounds; none where every setting is measured."""

    def __str__(self) -> str:
        """For progress."""
        more = "".join(f", {name} {value}" for name, value in self.more.items())
        return f"{self.solver} ({self.lane}) on {self.problem}, {self.scaling}{more}"

    @property
    def key(self) -> str:
        """A file name that is the same in every run for the same task."""
        text = json.dumps(
            [
                self.problem_set,
                self.problem,
                self.scaling,
                self.solver,
                self.lane,
                self.setting.text,
                dict(self.more),
                self.repeat,
                self.start,
            ],
            sort_keys=True,
        )
        return f"{self.solver}-{self.lane}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    def columns(self, settings: Mapping[str, Any] | None = None) -> Row:
        """The columns that every row begins with; ``settings`` are those that the solver was given."""
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
            "repeat": self.repeat,
            "host": os.uname().nodename,
            "settings": json.dumps(dict(settings or self.more), default=str),
        }

    def asked(self, cls: type[Solver], c: float) -> dict[str, Any]:
        """The settings for a problem whose constant is c."""
        return {**cls.at(self.setting.rung_text or self.setting.text, c), **self.more}


def settings_of(solver: Described) -> Sequence[Setting]:
    """The settings of a solver's ladder from loose to tight; the first is its defaults, unless a rung is the
    same."""
    default = setting_text(solver.defaults)
    rungs = [Setting(setting_text(rung), i, setting_text(rung) == default) for i, rung in enumerate(solver.ladder)]
    return rungs if any(rung.is_default for rung in rungs) else [Setting(default), *rungs]


def limited(solver: Described, limit: int) -> Setting:
    """The tightest setting with a limit of iterations, so that it is the limit that ends a solve."""
    rung = tightest(solver)
    return Setting(
        setting_text({**solver.ladder[-1], solver.iteration_setting: limit}), is_default=False, rung_text=rung.text
    )


def tightest(solver: Described) -> Setting:
    """The last setting of a solver's ladder."""
    return settings_of(solver)[-1]


@dataclass
class Outcome:
    """What came back from a child."""

    failure: str = ""
    """Nothing, "unsupported", "adapter_failed" or "out_of_memory"."""
    message: str = ""
    """The sentence that goes with a failure."""
    found: bool = False
    """Whether the solver reports success."""
    x: Vector | None = None
    y: Vector | None = None
    z: Vector | None = None
    z_box: Vector | None = None
    """Answer and duals in qpsolvers' conventions."""
    solver_status: str = ""
    reported_us: float = float("nan")
    iterations: int = -1
    mutated: bool = False
    """Whether the solver wrote into the arrays that it was given."""
    repeatable: bool = True
    """Whether the same data gave the same bits again."""
    asked: Mapping[str, Any] = field(default_factory=dict)
    """The settings that the solver was given."""
    returned: str = ""
    """Type of the answer where it is not an array."""
    seen: tuple[str, ...] = ()
    """What the process did that it must not."""
    preemptions: int = 0
    """How often the process was taken off its core while it was timed."""
    setup_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    update_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    solve_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def times(self) -> Mapping[str, Nanoseconds]:
        """Raw nanoseconds by what was timed, as a race keeps them."""
        return {}


class Request(ABC):
    """What a parent asks of a child, which answers it with the solver that it has loaded."""

    @abstractmethod
    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Do it; ``first`` says that nothing was compiled, loaded and allocated before. What is raised becomes an
        outcome, see `attempt`."""


def attempt(work: Callable[[], Outcome]) -> Outcome:
    """The outcome of work with a solver, or of what it raises."""
    try:
        return work()
    except Unsupported as error:
        return Outcome("unsupported", str(error))
    except MemoryError as error:
        return Outcome("out_of_memory", f"the memory limit was reached: {error}")
    except Exception as error:  # whatever a library raises is a finding about it, and the race goes on
        return Outcome("adapter_failed", f"{type(error).__name__}: {error}".strip().replace("\n", " ")[:500])
