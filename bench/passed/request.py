"""What is asked of a solver's process, and what comes back from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solvers.arrays import Vector
from solvers.protocol import Nanoseconds, Solver, Unsupported


@dataclass
class Outcome:
    """What came back from a child."""

    failure: str = ""
    """Nothing, "unsupported", "adapter_failed" or "out_of_memory"."""
    message: str = ""
    """The sentence that goes with a failure."""
    found: bool = False
    """What the solver itself says."""
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
    """Type of the answer where it is no array."""
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
        """Do it; ``first`` says that nothing was compiled, loaded and allocated before. What is raised becomes an outcome, see `attempt`."""


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
