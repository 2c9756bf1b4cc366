"""Comparison of two runs: solver lanes that became slower or faster, and tiers that they lost or gained.

Only measurements that both runs have are compared, at equal settings. With r the logarithm of the time of update and
solve in run b over that in run a, l a solver lane and u a problem in one scaling:

    r_lu = median of r over the settings of l on u
    e_lu = r_lu − median over l of r_lu                    the common change is that of the machine
    θ_l  = median over u of e_lu                           exp θ_l is the ratio of the lane
    D    = 1.4826 · median over l of |θ_l − median θ|      the deviation of the field
    I_l  = 95 % bootstrap interval of θ_l over the u, wider by 5 D at either end

All problems of a lane run in the same process, so the bootstrap misses variation between processes, such as memory
layout and the state of the core; D contains it, since most lanes do not change. A lane is slower or faster if I_l
excludes 0. There is no difference if I_l contains 0 and excludes ±log(smallest); otherwise, or if D exceeds a sixth of
log(smallest) (3 % for 1.2), the comparison cannot tell.

With three or four lanes, too few to estimate D, it is at least FEW_DEVIATE.

Of hot and interleaved times those are used whose D is smaller, and the others for lanes that lack them on enough
problems.

The first answer of a measurement is reproducible; the timed answers are of data that each run draws anew. A tier is
lost if run a reaches it with some setting, run b with none, and with run a's setting more problems became wrong than by
chance: BY_CHANCE of them (six coins fall on the same side with p = 3 %) or all of fewer, or a single one by its first
answer if both runs have the same seed and so the same problems.
"""

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
import pandas as pd
from scipy.stats import median_abs_deviation

from bench.derived.measurements import HOT, INTERLEAVED, Measurements
from bench.derived.tiers import LANE, MEASURED, right, tier_settings
from bench.messages.task import Status, Tier
from bench.store import Run
from bench.timing.clock import Effort

SMALLEST = 1.2
"""Default of the smallest ratio of times that matters."""
ROUNDING = 1e-9
"""Smallest deviation of the lanes: logarithms of equal times differ by their rounding."""
WIDER, SHARE = 5.0, 1.0 / 6.0
"""Widening of an interval at either end in deviations D, and largest D in log(smallest) for a finding."""
FEWEST_LANES, FEWEST_PROBLEMS = 3, 3
"""Smallest numbers of solver lanes, and of problems of a lane, for a finding."""
ENOUGH_LANES, FEW_DEVIATE = 5, 0.04
"""Number of solver lanes from which D is estimated, and what it is at least for fewer: the D of interleaved times
between two runs of the default race on a quiet machine was 1.7 to 4.3 % in ten pairs, and that of hot ones 1.3 to
2.6 %."""
DRAWS = 1_000
BY_CHANCE = 6
FAILURES = {*Status} - {Status.OK, Status.UNSUPPORTED, Status.NOT_RUN}
SLOWER, FASTER, SAME, CANNOT_TELL = "slower", "faster", "no difference", "cannot tell"
BLOCK = ["timed", "problem_set", "problem", "scaling"]
SOLVER_LANE = ["solver", "lane"]
NAMES = [*MEASURED, "setting", "start"]
"""Columns that identify the same measurement in two runs."""


@dataclass(frozen=True)
class Comparison:
    """Changes from run a to run b."""

    a: Run
    b: Run
    smallest: float
    times: pd.DataFrame
    """One row per solver lane; see `compare_times`."""
    field: pd.DataFrame
    """Common ``factor`` and ``deviation`` D of the field for each way of timing."""
    sentinel: float
    """Ratio of the times of the fixed piece of work that is timed beside the solvers."""
    lost: pd.DataFrame
    """LANE and ``tier``, one row per tier."""
    gained: pd.DataFrame
    failed: pd.DataFrame
    """SOLVER_LANE of those that fail where they did not, one row per lane."""
    alone: tuple[pd.DataFrame, pd.DataFrame]
    """Rows that only the first run has, and only the second."""
    common: int
    """Number of rows that both runs have."""

    @property
    def regressions(self) -> int:
        """Number of solver lanes that became slower or fail, plus tiers that were lost; 1 without common rows."""
        return self.count(SLOWER) + len(self.lost) + len(self.failed) + (not self.common)

    @property
    def differences(self) -> int:
        """Number of regressions and improvements."""
        return self.regressions + self.count(FASTER) + len(self.gained)

    @property
    def moved(self) -> bool:
        """Whether the field as a whole changed unlike the fixed piece of work, so that the cause is unknown."""
        return bool((np.abs(np.log(self.field.factor / self.sentinel)) > math.log(self.smallest)).any())

    @property
    def cannot_tell(self) -> bool:
        """Whether a change of times that matters may have gone unseen."""
        return self.moved or bool(self.count(CANNOT_TELL))

    def count(self, finding: str) -> int:
        """Number of solver lanes with this finding."""
        return int((self.times.finding == finding).sum())


def compare_runs(a: Run, b: Run, smallest: float = SMALLEST) -> Comparison:
    """Compare run b with run a; RunError if one is not a finished race. ``smallest`` is above 1."""
    first, second = Measurements.of(a), Measurements.of(b)
    times, field = compare_times(
        levels(first).merge(levels(second), on=[*NAMES, "timed"], suffixes=("_a", "_b")), smallest
    )
    rows = [
        found.field[found.field.status != Status.NOT_RUN].sort_values(NAMES, ignore_index=True)
        for found in (first, second)
    ]
    before, after = (part[_is_in(part, other)].reset_index(drop=True) for part, other in (rows, rows[::-1]))
    least = 1 if a.settings["settings"].get("seed") == b.settings["settings"].get("seed") else BY_CHANCE
    return Comparison(
        a,
        b,
        smallest,
        times,
        field,
        float(b.sentinel_samples().level_ns.median() / a.sentinel_samples().level_ns.median()),
        lost_tiers(before, after, least),
        lost_tiers(after, before, least),
        before[(before.status == Status.OK) & after.status.isin(FAILURES)][SOLVER_LANE].drop_duplicates(),
        (rows[0][~_is_in(*rows)], rows[1][~_is_in(*rows[::-1])]),
        len(before),
    )


def levels(found: Measurements) -> pd.DataFrame:
    """One row per answer and way of timing: NAMES, ``timed`` and ``level``, the logarithm of the median time of update
    plus solve, NaN for too few calls."""
    parts = []
    ok = found.field.loc[found.field.status == Status.OK, ["task", *NAMES]]
    for timed in (HOT, INTERLEAVED):
        rows = ok[[(task, timed) in found.calls for task in ok.task]]
        us = [found.calls[task, timed] for task in rows.task]
        parts.append(
            rows.assign(
                timed=timed,
                level=[
                    math.log(max(np.median(part), 1e-3)) if part.size >= Effort().fewest else math.nan for part in us
                ],
            )
        )
    return pd.concat(parts, ignore_index=True)


def compare_times(pairs: pd.DataFrame, smallest: float) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Compare the times of two runs.

    Parameters
    ----------
    pairs : DataFrame
        One row per task and way of timing: BLOCK, SOLVER_LANE, ``level_a`` and ``level_b``.
    smallest : float
        Smallest ratio that matters, above 1.

    Returns
    -------
    times : DataFrame
        One row per solver lane: SOLVER_LANE, ``timed``, ``problems``, ``ratio``, ``ratio_low``, ``ratio_high`` and
        ``finding``.
    field : DataFrame
        ``factor`` and ``deviation`` for each way of timing.
    """
    keys = [pairs[name] for name in [*BLOCK, *SOLVER_LANE]]
    own = (pairs.level_b - pairs.level_a).groupby(keys).median()
    machine = own.groupby(level=BLOCK).median()
    own -= own.groupby(level=BLOCK).transform("median")
    lanes = own.groupby(level=["timed", *SOLVER_LANE])
    field = pd.DataFrame(
        {
            "factor": np.exp(machine.groupby(level="timed").median()),
            "deviation": lanes.median().groupby(level="timed").agg(_deviation),
        }
    )
    chance, lines = np.random.default_rng(0), []
    for names, part in lanes:
        timed, solver, lane = cast(tuple[str, str, str], names)
        values, deviation = part.dropna().to_numpy(), float(field.deviation[timed])
        low, high = interval(values, deviation, chance)
        lines.append(
            (
                timed,
                solver,
                lane,
                values.size,
                *np.exp([part.median(), low, high]),
                _finding(low, high, deviation, smallest),
            )
        )
    times = pd.DataFrame(
        lines, columns=["timed", *SOLVER_LANE, "problems", "ratio", "ratio_low", "ratio_high", "finding"]
    )
    order = 1e3 * (times.problems < FEWEST_PROBLEMS) + times.timed.map(field.deviation).clip(upper=1e2)
    return times.loc[order.sort_values(kind="stable").index].drop_duplicates(SOLVER_LANE).sort_values(
        SOLVER_LANE, ignore_index=True
    ), field


def interval(values: np.ndarray, deviation: float, chance: np.random.Generator) -> tuple[float, float]:
    """Interval I_l of a lane from its e_lu; infinite for too few problems or lanes."""
    if values.size < FEWEST_PROBLEMS or not math.isfinite(deviation):
        return -math.inf, math.inf
    medians = np.median(values[chance.integers(0, values.size, (DRAWS, values.size))], axis=1)
    low, high = np.quantile(medians, (0.025, 0.975))
    return float(low) - WIDER * deviation, float(high) + WIDER * deviation


def _deviation(theta: pd.Series) -> float:
    if theta.count() < FEWEST_LANES:
        return math.inf
    least = ROUNDING if theta.count() >= ENOUGH_LANES else FEW_DEVIATE
    return max(least, float(median_abs_deviation(theta, scale="normal", nan_policy="omit")))


def _finding(low: float, high: float, deviation: float, smallest: float) -> str:
    if low > 0.0 or high < 0.0:
        return SLOWER if low > 0.0 else FASTER
    return SAME if max(-low, high, deviation / SHARE) < math.log(smallest) else CANNOT_TELL


def lost_tiers(a: pd.DataFrame, b: pd.DataFrame, least: int = 1) -> pd.DataFrame:
    """LANE and ``tier`` of the tiers that rows a reach and rows b, the same tasks in the same order, do not.

    ``least`` is the number of first answers that have to become wrong.
    """
    both = tier_settings(a).merge(tier_settings(b), on=[*LANE, "tier"], suffixes=("", "_b"))
    found = both[(both.setting != "") & (both.setting_b == "")].to_dict("records")
    return pd.DataFrame(
        [[line[name] for name in (*LANE, "tier")] for line in found if _is_lost(a, b, line, least)],
        columns=[*LANE, "tier"],
    )


def _is_lost(a: pd.DataFrame, b: pd.DataFrame, line: Mapping[Hashable, object], least: int) -> bool:
    tier = Tier(str(line["tier"]))
    here = (a[[*LANE, "setting"]] == [line[name] for name in (*LANE, "setting")]).all(axis=1) & (a.start == "cold")

    def became_wrong(first: pd.DataFrame, second: pd.DataFrame) -> int:
        return int(right(first[here], tier).sum() - right(second[here], tier).sum())

    every = int(right(a[here], tier).sum())
    first = became_wrong(_first_answers(a), _first_answers(b))
    return first >= min(least, every) or became_wrong(a, b) >= min(BY_CHANCE, every)


def _first_answers(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows without the results of timed answers."""
    return rows.assign(timed_gap=math.nan, timed_violation=math.nan, timed_stage_excess=math.nan)


def _is_in(rows: pd.DataFrame, other: pd.DataFrame) -> np.ndarray:
    return pd.MultiIndex.from_frame(rows[NAMES]).isin(pd.MultiIndex.from_frame(other[NAMES]))
