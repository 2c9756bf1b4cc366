"""The rule of a decision, and the candidates of a race: solver lanes at a setting each.

They are lines of what its report derives from its rows, with the same settings, times and percentiles:
the setting is the loosest at which cost gap and violation, of first and timed answers, are within the accuracy with a
margin of ten on every problem, else of three, else of one. At least 99 timed answers to each problem are judged, so
that another misses in at most 3 % of the cases (95 % confidence).

The machine explains some of the deadlines that a candidate misses. A long call is more likely to be interrupted than a
short one, so the calls of the solver that does nothing (null) are grouped into blocks as long as a call of the
candidate. Let T be the candidate's median time, D the deadline, n_i the times of the M null calls in order, ñ the
median of the series of call i, and j a block of b consecutive calls:

    b = T / median(n), rounded        K = ⌊M / b⌋ blocks
    S_j = Σ (n_i − ñ),  i in j        delay of a block
    k = #{j : T + S_j − median(S) > D}

k of K blocks would have been late although the candidate itself needs only T ≤ D. The share of late calls that the
machine explains is

    r = min(B(k, K), k / K + 0.01),   B the upper 95 % bound of Clopper and Pearson (`bench.timing.percentiles`),

and of N calls of the candidate it explains at most ⌈r N⌉, and at least ⌊(1 − B(K − k, K)) N⌋. The second term matters
if K is small and the bound reflects the sample size rather than the machine: delays that were not observed explain at
most one call in a hundred. If T > D, the solver is late by itself, and nothing is explained.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.derived.measurements import HOT, INTERLEAVED, NULL_SOLVER, Measurements, Microseconds
from bench.derived.schedule import LATE, on_schedule
from bench.derived.tiers import PROBLEM, TOLERANCE, chosen_settings, distance, measured, supported
from bench.messages.columns import TYPICAL
from bench.messages.task import Tier
from bench.report.words import marked, settings_label
from bench.store import Run, RunError
from bench.timing.percentiles import CONFIDENCE, percentile, rate_bound
from bench.timing.schedule import PERIOD_US
from piezo_model.checks import check
from piezo_model.json_file import decoded
from piezo_model.learning.settings import EXACT_SOLVERS
from piezo_model.solving import require_setting
from solvers import Lane, find

QUANTILES = (0.999, 0.99, 0.5)
"""The first one for which every qualified candidate has enough calls decides."""
UNOBSERVED_SHARE = 0.01
"""Largest share of calls that unobserved delays may explain."""
SHORTEST_US = 1e-3
MOST_MISSES = 0.03
"""Largest rate of misses on a problem, at 95 % confidence."""
ENOUGH = math.ceil(math.log(1.0 - CONFIDENCE) / math.log(1.0 - MOST_MISSES))
"""Number of judged answers without a miss that show it."""


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
            f"cost gap and violation of at most {self.accuracy:g} on every problem, by the first and at least {ENOUGH} "
            f"timed answers, at most {self.misses} "
            f"deadlines of {self.deadline_us:g} µs missed beyond those that the machine itself misses, then the "
            f"lowest p99.9; lanes {', '.join(self.lanes)}."
        )


@dataclass(frozen=True)
class Candidate:
    """One solver lane at one setting, with the figures that the rule needs."""

    solver: str
    lane: str
    setting: str
    """In the format of ``solvers.protocol.setting_text``."""
    margin: float
    """Factor by which it is within the accuracy on every problem; 0 if no setting is."""
    worst: float
    """Largest relative cost gap or violation."""
    problems: int
    right: int
    samples: int
    missed: int
    explained: tuple[int, int]
    """Fewest and most missed deadlines that the machine explains."""
    times_us: tuple[float, ...]
    """Percentiles of QUANTILES; NaN for one that the calls do not support."""
    calls: int
    """Number of calls of the percentiles."""
    judged: int
    """Fewest timed answers to a problem that were judged."""
    is_late: bool
    """Whether it was raced on the schedule and is late there."""

    @property
    def miss_rate(self) -> float:
        """The largest rate of misses on a problem that its judged answers leave open, if none of them misses."""
        return float(rate_bound(0, self.judged))

    @property
    def settings(self) -> dict[str, Any]:
        """Settings on the solver's ladder, for a problem whose constant is 1."""
        return decoded(self.setting, dict[str, Any])

    @property
    def tier(self) -> Tier:
        """Most exact tier that it reaches on every problem."""
        return next(
            (tier for tier in (Tier.EXACT, Tier.HIGH, Tier.MID, Tier.LOW) if self.worst <= TOLERANCE[tier]),
            Tier.DEFAULT,
        )

    @property
    def own_misses(self) -> tuple[int, int]:
        """Fewest and most deadlines missed beyond those that the machine explains."""
        fewest, most = self.explained
        return max(0, self.missed - most), max(0, self.missed - fewest)

    @property
    def name(self) -> str:
        """Solver, lane and setting, as shown to users."""
        label = settings_label(self.setting)
        return f"{marked(self.solver)} ({self.lane}{label and f', {label}'})"

    def failing(self, rule: Rule) -> str:
        """Why it does not qualify, or "". Few calls are no reason as long as enough of their answers were judged."""
        if not self.margin:
            return (
                f"has a cost gap or violation above {rule.accuracy:g} on {self.problems - self.right} of "
                f"{self.problems} problems at its best setting, or an answer that it does not report as found"
            )
        if not self.samples:
            return "has no times"
        if self.is_late:
            return "is late on the schedule of 8 kHz more often than the machine itself"
        if self.own_misses[0] > rule.misses:
            return (
                f"misses {self.missed} of {self.samples} deadlines, {self.own_misses[0]} more than the machine "
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
            require_setting(self.setting, self.solver, self.lane)
        except ValueError:
            return "was raced at a setting that its ladder no longer has, so race it again"
        if self.judged < ENOUGH:
            return (
                f"was judged on {self.judged} timed answers to a problem, and {ENOUGH} without a miss are needed to "
                f"show a miss rate of at most {MOST_MISSES:.0%}; race it with a larger --budget"
            )
        return ""

    def metrics(self) -> dict[str, Any]:
        """Figures for JSON, in the units of the report."""
        p999, p99, median = (None if math.isnan(us) else us for us in self.times_us)
        fewest, most = self.own_misses
        return {
            "solver": self.solver,
            "lane": self.lane,
            "settings": self.settings,
            "tier": str(self.tier),
            "margin": self.margin,
            "worst_gap_or_violation": self.worst if math.isfinite(self.worst) else None,
            "problems": self.problems,
            "right": self.right,
            "judged": self.judged,
            "miss_rate_at_most": self.miss_rate,
            "samples": self.samples,
            "missed": self.missed,
            "missed_beyond_floor": fewest,
            "missed_at_most_beyond_floor": most,
            "median_us": median,
            "p99.9_us": p999,
            "p99_us": p99,
        }


def candidates(run: Run, rule: Rule) -> Iterator[Candidate]:
    """Candidates on scaled data from a cold start, as the compensator solves them; times include update and solve.

    Deadlines count hot and interleaved calls; percentiles hot calls only, since only one setting is interleaved.
    """
    measurements = Measurements.of(run)
    at_8_khz = on_schedule(measurements)
    at_8_khz = at_8_khz[(at_8_khz.scaling == "scaled") & (at_8_khz.schedule == LATE)]
    late = {*at_8_khz[["solver", "lane", "setting"]].itertuples(index=False, name=None)}
    here = measurements.rows[(measurements.rows.scaling == "scaled") & (measurements.rows.start == "cold")]
    nothing = measurements.rows.task[measurements.rows.solver == NULL_SOLVER]
    floor = [measurements.pooled([task], timed) for task in nothing for timed in (HOT, INTERLEAVED)]
    idle = np.concatenate([np.zeros(0), *floor])
    missed = np.count_nonzero(idle > rule.deadline_us)
    check(
        missed <= idle.size / 2,
        f"{run.path}: a solver that does nothing misses {missed} of {idle.size} deadlines of {rule.deadline_us:g} µs, "
        "so this run says nothing about them",
        RunError,
    )
    every = measurements.all_rows[
        (measurements.all_rows.scaling == "scaled") & measurements.all_rows.lane.isin([*map(str, rule.lanes)])
    ]
    rows = supported(measured(every[every.solver != NULL_SOLVER]))
    # a learner does not use an answer that its solver does not call found, unless the core solves in its place
    for line in chosen_settings(
        rows.assign(error=distance(rows).mask((rows.message != "") & ~rows.solver.isin(EXACT_SOLVERS), math.inf)),
        rule.accuracy,
    ):
        of_lane = here[(here.solver == line["solver"]) & (here.lane == line["lane"])]
        chosen = of_lane[(of_lane.setting == line["furthest"]) & (of_lane.rung >= 0)]
        calls, hot = measurements.pooled(chosen.task, HOT, INTERLEAVED), measurements.pooled(chosen.task)
        problems = int(of_lane.groupby(PROBLEM).ngroups)  # those that the solver does not take count, too
        yield Candidate(
            line["solver"],
            line["lane"],
            line["furthest"],
            line["margin"] if line["right"] == problems else 0.0,
            line["largest"] if line["problems"] == problems else math.inf,
            problems,
            line["right"],
            calls.size,
            int(np.count_nonzero(calls > rule.deadline_us)),
            explained(floor, calls, rule.deadline_us),
            (*(percentile(hot, q) for q in QUANTILES[:-1]), float(chosen.answer_us.dropna().agg(TYPICAL))),
            hot.size,
            int(chosen.judged.min()) if len(chosen) else 0,
            (line["solver"], line["lane"], line["furthest"]) in late,
        )


def explained(series: Sequence[Microseconds], calls: Microseconds, deadline_us: float) -> tuple[int, int]:
    """Fewest and most late calls of a candidate, of times (N,), that the machine explains; 0 if the solver that does
    nothing, whose times come in series of consecutive calls, was not measured."""
    n = np.concatenate([np.zeros(0), *series])
    if not calls.size or not n.size or (T := float(np.median(calls))) > deadline_us:
        return 0, 0
    excess = np.concatenate([times - np.median(times) for times in series if times.size])
    b = min(n.size, max(1, round(T / max(float(np.median(n)), SHORTEST_US))))
    K = n.size // b
    S = excess[: K * b].reshape(K, b).sum(axis=1)
    k = int(np.count_nonzero(T + S - np.median(S) > deadline_us))
    most = math.ceil(min(rate_bound(k, K), k / K + UNOBSERVED_SHARE) * calls.size)
    return math.floor((1.0 - rate_bound(K - k, K)) * calls.size), most
