"""What is asked of a solver's process."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from bench.passed.outcome import Outcome
from solvers.protocol import Solver, Unsupported


class Request(ABC):
    """What a parent asks of a child, which answers it with the solver that it has loaded."""

    @abstractmethod
    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Do it; ``first`` says that nothing was compiled, loaded and allocated before."""


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
