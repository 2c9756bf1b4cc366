"""What is raced and how; stored with the run, so that it can be resumed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Self, TypeVar

from bench.problems.protocol import SCALINGS
from bench.processes.line_up import Limits
from bench.store import Run, RunError
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from solvers import Lane, Tier

LANES = tuple(lane for lane in Lane if lane is not Lane.CODEGEN)
"""The lanes of a race that asks for none: those whose solvers need not be built first."""


def option(default: int, text: str, least: int = 1) -> Any:
    """A whole number that belongs to one kind of race and that the command line asks for."""
    return field(default=default, metadata={"help": text, "least": least})


@dataclass(frozen=True)
class RaceSettings:
    """What is raced and how, as far as all kinds of race share it."""

    problem_sets: tuple[str, ...] = ("paper",)
    solvers: tuple[str, ...] = ()
    """Names to race; empty for all."""
    lanes: tuple[Lane, ...] = LANES
    tiers: tuple[Tier, ...] = tuple(Tier)
    scalings: tuple[Scaling, ...] = SCALINGS
    limit: int | None = None
    """Number of problems of each set; None for all."""
    seed: int = 0
    effort: Effort = field(default_factory=Effort)
    time_limit_s: float = 20.0
    memory_mb: int = 2048
    solver_files: tuple[str, ...] = ()
    repeats: int = 1
    """Fresh processes for each solver lane."""
    set_options: dict[str, str] = field(default_factory=dict)
    """Files and columns that problem sets need or take, by name."""

    @property
    def limits(self) -> Limits:
        """What a solver may take."""
        return Limits(self.time_limit_s, self.memory_mb)

    def to_dict(self) -> dict[str, Any]:
        """Settings as JSON can hold them."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Make the settings of :meth:`to_dict`."""
        tuples = {name: tuple(value) for name, value in data.items() if isinstance(value, list)}
        lanes, tiers = tuple(Lane(x) for x in data["lanes"]), tuple(Tier(x) for x in data["tiers"])
        return cls(**{**data, **tuples, "lanes": lanes, "tiers": tiers, "effort": Effort(**data["effort"])})


Settings = TypeVar("Settings", bound=RaceSettings)


def settings_of(run: Run, kind: type[Settings]) -> Settings:
    """The settings that a run was started with."""
    try:
        return kind.from_dict(run.settings["settings"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RunError(f"{run.path / 'run.json'}: does not hold the settings of a race ({error!r})") from None
