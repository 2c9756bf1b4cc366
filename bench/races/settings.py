"""The settings of a race, which are stored in its run so that it can be resumed."""

from dataclasses import dataclass, field, fields
from typing import Annotated, Any

from msgspec import Meta

from bench.messages.task import Tier
from bench.problems.protocol import SCALINGS
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from solvers import Lane

MOST = 10**9
Positive = Annotated[int, Meta(ge=1, le=MOST)]


def option(default: float, text: str, least: float = 1) -> Any:
    """A number that is an option of one kind of race on the command line; an integer if its default is one."""
    return field(default=default, metadata={"help": text, "least": least})


def fixed(value: Any) -> Any:
    """A setting that is constant for a kind of race; the command line refuses its option."""
    return field(default_factory=lambda: value, init=False)


@dataclass(frozen=True)
class RaceSettings:
    """Settings that all kinds of race share; a kind marks those that do not apply with :func:`fixed`."""

    problem_sets: tuple[str, ...] = ("paper",)
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
    time_limit_s: Annotated[float, Meta(ge=0.1, le=1e7)] = 20.0
    memory_mb: Annotated[int, Meta(ge=16, le=2**30)] = 2048
    solver_files: tuple[str, ...] = ()
    repeats: Positive = 1
    """Number of fresh processes of each solver lane."""
    set_options: dict[str, str] = field(default_factory=dict)
    """Files and columns for the problem sets, by name."""

    def __post_init__(self) -> None:
        """ValueError if an option is outside its range."""
        for each in fields(self):
            if "least" in each.metadata and not each.metadata["least"] <= getattr(self, each.name) <= MOST:
                raise ValueError(
                    f"{each.name} must be from {each.metadata['least']} to {MOST}, not {getattr(self, each.name)}"
                )

    @property
    def code(self) -> set[str]:
        """Paths of the Python files that a race executes: solvers, and a test set of qpbenchmark."""
        return {*self.solver_files, *(path for name, path in self.set_options.items() if name == "test_set")}


@dataclass(frozen=True)
class OwnProblemSettings(RaceSettings):
    """Settings of a race that has its own problems instead of problem sets."""

    problem_sets: tuple[str, ...] = fixed(("paper",))
    scalings: tuple[Scaling, ...] = fixed(SCALINGS)
    set_options: dict[str, str] = fixed({})
    problems: tuple[str, ...] = fixed(())


@dataclass(frozen=True)
class TierSettings(OwnProblemSettings):
    """Settings of a race in which the solvers' settings are those chosen for a tier in a one-shot race."""

    limit: int = fixed(0)
    tiers: tuple[Tier, ...] = (Tier.HIGH,)
    settings_run: str = ""
    """Folder of the one-shot race; "" for the reference run."""
