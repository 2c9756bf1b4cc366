"""What is raced and how; stored with the run, so that it can be resumed."""

from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Any, TypeVar

from msgspec import Meta

from bench.problems.protocol import SCALINGS
from bench.store import Run, RunError
from bench.timing.clock import Effort
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import brief, convert
from solvers import Lane, Tier

LANES = tuple(lane for lane in Lane if lane is not Lane.CODEGEN)
"""The lanes of a race that asks for none: those whose solvers need not be built first."""


MOST = 10**9
Positive = Annotated[int, Meta(ge=1, le=MOST)]


def option(default: float, text: str, least: float = 1) -> Any:
    """A number that belongs to one kind of race and that the command line asks for, a whole one where its default
    is."""
    return field(default=default, metadata={"help": text, "least": least})


def fixed(value: Any) -> Any:
    """A setting that is the same in every race of a kind: nobody can set it, and the command line refuses its
    option."""
    return field(default_factory=lambda: value, init=False)


@dataclass(frozen=True)
class RaceSettings:
    """What is raced and how, as far as all kinds of race share it.

    A kind says with :func:`fixed` which of these its race does not go by.
    """

    problem_sets: tuple[str, ...] = ("paper",)
    solvers: tuple[str, ...] = ()
    """Names to race; empty for all."""
    lanes: tuple[Lane, ...] = LANES
    scalings: tuple[Scaling, ...] = SCALINGS
    limit: Annotated[int, Meta(ge=0, le=MOST)] = 0
    """Number of problems of each set; 0 for all."""
    seed: int = 0
    effort: Effort = field(default_factory=Effort)
    time_limit_s: Annotated[float, Meta(ge=0.1, le=1e7)] = 20.0
    memory_mb: Annotated[int, Meta(ge=16, le=2**30)] = 2048
    solver_files: tuple[str, ...] = ()
    repeats: Positive = 1
    """Fresh processes for each solver lane."""
    set_options: dict[str, str] = field(default_factory=dict)
    """Files and columns that problem sets need or take, by name."""

    def __post_init__(self) -> None:
        """ValueError for an option below its least value."""
        for each in fields(self):
            if "least" in each.metadata and not each.metadata["least"] <= getattr(self, each.name) <= MOST:
                raise ValueError(
                    f"{each.name} must be from {each.metadata['least']} to {MOST}, not {getattr(self, each.name)}"
                )

    def to_dict(self) -> dict[str, Any]:
        """Settings as JSON can hold them."""
        return asdict(self)


@dataclass(frozen=True)
class OwnProblemSettings(RaceSettings):
    """Of a race that has its own problems and takes no problem sets."""

    problem_sets: tuple[str, ...] = fixed(("paper",))
    scalings: tuple[Scaling, ...] = fixed(SCALINGS)
    set_options: dict[str, str] = fixed({})


@dataclass(frozen=True)
class TierSettings(OwnProblemSettings):
    """Of a race in which each solver has the setting that stands for a tier in a table of measurements."""

    limit: int = fixed(0)
    tiers: tuple[Tier, ...] = (Tier.HIGH,)
    settings_run: str = ""
    """Folder of the one-shot race whose settings are taken; that of the reference run where it is ""."""


Settings = TypeVar("Settings", bound=RaceSettings)


def settings_of(run: Run, kind: type[Settings]) -> Settings:
    """The settings that a run was started with."""
    try:
        return convert(run.settings["settings"], kind)
    except ValueError as error:
        raise RunError(f"{run.path / 'run.json'}: does not hold the settings of a race: {brief(error)}") from None
