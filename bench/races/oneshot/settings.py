"""Settings of a one-shot race and of an anytime race."""

from dataclasses import dataclass, field

from bench.races.settings import RaceSettings, option
from piezo_model.identification_problem import Scaling


@dataclass(frozen=True)
class OneshotSettings(RaceSettings):
    """Settings of a one-shot race."""

    problem_sets: tuple[str, ...] = ("paper", "measured")
    rounds: int = option(10, "Rounds in which the solvers are interleaved.", least=0)
    """Rounds of interleaved solves, one update and solve of each solver a round; 0 for none."""
    keep_misses: int = option(5, "Solver lanes whose worst miss of 1e-9 is kept as a file.", least=0)
    """Most solver lanes of which a missed answer is saved with its program."""
    given: dict[str, str] = field(default_factory=dict)
    """Settings of the user's for solvers by name, as JSON, which are measured in place of the ladder."""
    iteration_limits: tuple[int, ...] = ()
    """Ascending iteration limits at which solvers that have one are measured in addition."""


@dataclass(frozen=True)
class AnytimeSettings(OneshotSettings):
    """Settings of a race that measures the accuracy within a time."""

    scalings: tuple[Scaling, ...] = ("scaled",)
    iteration_limits: tuple[int, ...] = (*(step * 10**power for power in range(6) for step in (1, 2, 5)), 10**6)
