"""The rule of a decision, and its candidates.

A candidate is a solver lane at one setting for all problems: the loosest one at which cost gap and violation, of first
and timed answers, are within the accuracy with a margin of ten on every problem, else of three, else of one. A lane
without such a setting does not qualify.
"""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bench.derived.accuracy import TOLERANCE
from bench.derived.measurements import Microseconds
from bench.derived.tier_settings import choice
from bench.derived.tier_settings import margin as margin_of
from bench.messages.verdict import Tier
from bench.report.words import marked, settings_label
from bench.timing.percentiles import Percentile, percentile
from bench.timing.schedule import PERIOD_US
from piezo_model.json_file import decoded
from piezo_model.learning.solving import require_setting
from solvers import Lane, find

QUANTILES = (0.999, 0.99, 0.5)
"""The first one for which every qualified candidate has enough calls decides."""


@dataclass(frozen=True)
class Rule:
    """Requirements on a solver."""

    accuracy: float = 1e-9
    """Largest relative cost gap and violation."""
    deadline_us: float = PERIOD_US
    """Sampling period of the controller."""
    lanes: tuple[Lane, ...] = (Lane.KERNEL, Lane.DIRECT)
    """Lanes that the controller can run."""
    misses: int = 0
    """Most deadlines missed beyond the floor."""

    @property
    def sentence(self) -> str:
        """The rule in words."""
        return (
            f"cost gap and violation of at most {self.accuracy:g} on every problem, by first and timed answers, at "
            f"most {self.misses} "
            f"deadlines of {self.deadline_us:g} µs missed beyond those that the machine itself misses, then the "
            f"lowest p99.9; lanes {', '.join(self.lanes)}."
        )


@dataclass(frozen=True)
class Choice:
    """The setting of a solver lane, chosen from a table of errors."""

    setting: str
    """In the format of ``solvers.protocol.setting_text``."""
    margin: float
    """Factor by which it is within the accuracy on every problem; 0 if no setting is, and this is right most often."""
    worst: float
    """Largest relative cost gap or violation."""
    problems: int
    right: int

    @classmethod
    def of(cls, distances: NDArray[np.float64], settings: list[str], accuracy: float) -> Self:
        """Choose by the distances from the optimum, shape (problems, settings from loose to tight)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.nan_to_num(distances / accuracy, nan=math.inf, posinf=math.inf)
        counts, found = (errors <= 1.0).sum(axis=0), choice(errors)
        # of settings that are right on as many problems, the tightest
        at = int(counts.size - 1 - np.argmax(counts[::-1])) if found is None else found
        return cls(
            settings[at],
            0.0 if found is None else margin_of(errors[:, at]),
            float(distances[:, at].max()),
            len(errors),
            int(counts[at]),
        )


@dataclass(frozen=True)
class Candidate:
    """One solver lane at one setting, with the figures that the rule needs."""

    solver: str
    lane: str
    chosen: Choice
    samples: int
    missed: int
    explained: tuple[int, int]
    """Fewest and most missed deadlines that the floor explains."""
    time_us: float
    """Median, as in the report of the race."""
    tail: tuple[Percentile, ...]
    """Percentiles of QUANTILES."""

    @classmethod
    def of(
        cls,
        key: tuple[str, str],
        chosen: Choice,
        calls: Microseconds,
        explained: tuple[int, int],
        deadline_us: float,
        tail: Microseconds,
        time_us: float,
    ) -> Self:
        """Count deadlines in all calls and take percentiles of ``tail``."""
        return cls(
            *key,
            chosen,
            calls.size,
            int(np.count_nonzero(calls > deadline_us)),
            explained,
            time_us,
            tuple(percentile(tail, q) for q in QUANTILES),
        )

    @property
    def settings(self) -> dict[str, Any]:
        """Settings on the solver's ladder, for a problem whose constant is 1."""
        return decoded(self.chosen.setting, dict[str, Any])

    @property
    def tier(self) -> Tier:
        """Most exact tier that it reaches on every problem."""
        return next(
            (tier for tier in (Tier.EXACT, Tier.HIGH, Tier.MID, Tier.LOW) if self.chosen.worst <= TOLERANCE[tier]),
            Tier.DEFAULT,
        )

    @property
    def beyond_floor(self) -> int:
        """Deadlines missed for certain beyond those that the floor explains."""
        return max(0, self.missed - self.explained[1])

    @property
    def own_misses(self) -> str:
        """How many missed deadlines are the solver's own, in words."""
        most = max(0, self.missed - self.explained[0])
        if self.beyond_floor == most:
            return f"{most or 'none'} of them its own"
        return f"{self.beyond_floor} to {most} of them its own, which this run cannot tell more closely"

    @property
    def name(self) -> str:
        """Solver, lane and setting, as shown to users."""
        label = settings_label(self.chosen.setting)
        return f"{marked(self.solver)} ({self.lane}{label and f', {label}'})"

    def failing(self, rule: Rule) -> str:
        """Why it does not qualify, or "". Having few calls is no reason."""
        it = self.chosen
        if not it.margin:
            return (
                f"has a cost gap or violation above {rule.accuracy:g} on {it.problems - it.right} of {it.problems} "
                "problems at its best setting"
            )
        if not self.samples:
            return "has no times"
        if self.beyond_floor > rule.misses:
            return (
                f"misses {self.missed} of {self.samples} deadlines, {self.beyond_floor} more than the machine "
                "itself explains"
            )
        try:
            find(self.solver, self.lane)
        except KeyError:
            return (
                "comes from a solver file of your own or an older version, and a compensator can start only solvers "
                "that are installed with piezobench"
            )
        try:
            require_setting(it.setting, self.solver, self.lane)
        except ValueError:
            return "was raced at a setting that its ladder no longer has, so race it again"
        return ""

    def time(self, by: int) -> float:
        """Percentile of that index, or the median, µs."""
        return self.time_us if by == len(QUANTILES) - 1 else self.tail[by].value or math.nan

    def figures(self) -> dict[str, Any]:
        """Figures for JSON, in the units of the report."""
        it = self.chosen
        return {
            "solver": self.solver,
            "lane": self.lane,
            "settings": self.settings,
            "tier": str(self.tier),
            "margin": it.margin,
            "worst_gap_or_violation": it.worst if math.isfinite(it.worst) else None,
            "problems": it.problems,
            "right": it.right,
            "samples": self.samples,
            "missed": self.missed,
            "missed_beyond_floor": self.beyond_floor,
            "missed_at_most_beyond_floor": max(0, self.missed - self.explained[0]),
            "median_us": None if math.isnan(self.time_us) else self.time_us,
            **{f"{each.name}_us": each.value for each in self.tail[:-1]},
        }
