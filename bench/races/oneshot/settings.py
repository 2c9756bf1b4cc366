"""What is raced in a one-shot race and how."""

from __future__ import annotations

from dataclasses import dataclass

from bench.races.settings import RaceSettings, option
from piezo_model.identification_problem import Scaling


@dataclass(frozen=True)
class OneshotSettings(RaceSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    problem_sets: tuple[str, ...] = ("paper", "measured")
    rounds: int = option(10, "Turns of each solver in shuffled rounds with the others.", least=0)
    """Rounds in which solvers take turns, one update and solve each; 0 leaves them out."""
    iteration_limits: tuple[int, ...] = ()
    """Limits at which solvers that have one are measured beside their settings, ascending."""


@dataclass(frozen=True)
class AnytimeSettings(OneshotSettings):
    """Of a race that asks how exact an answer is after so much time."""

    scalings: tuple[Scaling, ...] = ("scaled",)
    iteration_limits: tuple[int, ...] = (*(step * 10**power for power in range(6) for step in (1, 2, 5)), 10**6)

