"""What is raced in a one-shot race and how."""

from __future__ import annotations

from dataclasses import dataclass

from bench.races.settings import RaceSettings, option


@dataclass(frozen=True)
class OneshotSettings(RaceSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    problem_sets: tuple[str, ...] = ("paper", "measured")
    rounds: int = option(10, "Turns of each solver in shuffled rounds with the others.", least=0)
    """Rounds in which solvers take turns, one update and solve each; 0 leaves them out."""

