"""What is raced and how; stored with the run, so that it can be resumed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Self

from bench.problems.protocol import SCALINGS
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from solvers import Lane, Tier

LANES = tuple(lane for lane in Lane if lane is not Lane.CODEGEN)
"""The lanes of a race that asks for none: those whose solvers need not be built first."""


class RaceError(ValueError):
    """What is asked for cannot be raced; the message is one sentence that says why."""


@dataclass(frozen=True)
class RaceSettings:
    """What is raced and how."""

    problem_sets: tuple[str, ...] = ("paper",)
    solvers: tuple[str, ...] = ()
    """Names to race; empty for all."""
    lanes: tuple[Lane, ...] = LANES
    tiers: tuple[Tier, ...] = (Tier.DEFAULT, Tier.HIGH)
    scalings: tuple[Scaling, ...] = SCALINGS
    limit: int | None = None
    """Number of problems of each set; None for all."""
    seed: int = 0
    effort: Effort = field(default_factory=Effort)
    time_limit_s: float = 20.0
    memory_mb: int = 2048
    solver_files: tuple[str, ...] = ()
    rounds: int = 10
    """Rounds in which solvers take turns, one update and solve each; 0 leaves them out."""
    repeats: int = 1
    """Fresh processes for each solver lane."""
    set_options: dict[str, str] = field(default_factory=dict)
    """Files and columns that problem sets need or take, by name."""

    @property
    def interleaved_tier(self) -> Tier:
        """The tier at which solvers take turns: the most exact one."""
        return max(self.tiers, key=list(Tier).index)

    def to_dict(self) -> dict[str, Any]:
        """Settings as JSON can hold them."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Make the settings of :meth:`to_dict`."""
        tuples = {name: tuple(value) for name, value in data.items() if isinstance(value, list)}
        lanes, tiers = tuple(Lane(x) for x in data["lanes"]), tuple(Tier(x) for x in data["tiers"])
        return cls(**{**data, **tuples, "lanes": lanes, "tiers": tiers, "effort": Effort(**data["effort"])})
