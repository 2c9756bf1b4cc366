"""The settings of a race, which are stored in its run so that it can be resumed."""

from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from bench.problems.protocol import SCALINGS
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from solvers import Lane

MOST = 10**9


def option(text: str, least: float = 0, flag: str = "", metavar: str = "N", most: float = MOST) -> Meta:
    """Of a number from ``least`` to ``most`` that is an option of the command line, under its own name or as
    ``flag``."""
    return Meta(ge=least, le=most, description=text, extra={"flag": flag, "metavar": metavar})


@dataclass(frozen=True)
class RaceSettings:
    """Settings of a race; the command line has an option for each."""

    problem_sets: tuple[str, ...] = ("paper", "measured")
    solvers: tuple[str, ...] = ()
    """Names to race; empty for all."""
    lanes: tuple[Lane, ...] = tuple(Lane)
    scalings: tuple[Scaling, ...] = SCALINGS
    limit: Annotated[int, Meta(ge=0, le=MOST)] = 0
    """Number of problems of each set, evenly spread over it; 0 for all."""
    problems: tuple[str, ...] = ()
    """Names of the problems to race, as ``name`` or ``set/name``; empty for all."""
    seed: int = 0
    effort: Effort = field(default_factory=Effort)
    time_limit_s: Annotated[float, option("Longest duration of a task", 0.1, "--time-limit", "SECONDS", 1e6)] = 20.0
    memory_mb: Annotated[int, option("Most memory that a solver may allocate", 16, "--memory", "MB")] = 2048
    solver_files: tuple[str, ...] = ()
    repeats: Annotated[int, option("Number of times that each solver is measured, each in a fresh process", 1)] = 1
    set_options: dict[str, str] = field(default_factory=dict)
    """Files and columns for the problem sets, by name."""
    rounds: Annotated[int, option("Rounds in which the solvers are interleaved, 0 for none")] = 10
    """Rounds of interleaved solves, one update and solve of each solver a round."""
    schedule: Annotated[int, option("Samples on a schedule of 8 kHz, where answers may be late, 0 for none")] = 0
    """Samples of each problem that come due every 125 µs, whether the solver is ready or not."""
    keep_misses: Annotated[int, option("Solver lanes whose worst miss of 1e-9 is kept as a file")] = 5
    """Most solver lanes of which a missed answer is saved with its program."""
    given: dict[str, str] = field(default_factory=dict)
    """Settings of the user's for solvers by name, as JSON, which are measured in place of the ladder."""

    @property
    def longest_s(self) -> float:
        """Longest answer, in seconds, after which tighter settings are tried: a tenth of the time limit."""
        return self.time_limit_s / 10.0

    @property
    def code(self) -> set[str]:
        """Paths of the Python files that a race executes: solvers, and a test set of qpbenchmark."""
        return {*self.solver_files, *(path for name, path in self.set_options.items() if name == "test_set")}
