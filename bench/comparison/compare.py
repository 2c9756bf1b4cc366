"""Comparison of runs: solver lanes that became slower or faster, and tiers that they lost or gained.

Rows meet by JOIN: the digest of the problem, whatever its name or file, its scaling and start, the solver and its lane,
and what the setting requests beyond the defaults of its version. So a default meets a default, whatever it is set to,
and a rung of the ladder the same rung, whatever settings the adapter fixes for all. The version is what is compared,
and no key: an edited file, two releases, and changed defaults meet.

With r the logarithm of the time of update and solve in run b over that in run a, l a solver lane and u a problem in one
scaling:

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

A tier is lost if run a reaches it with some setting that both have, run b with none, and run b is shown to be worse
with the setting of run a: by a first answer, which the digest makes reproducible, or by the rate of misses of the timed
ones, whose data each run draws anew. Run a has none. If a problem u has the same rate in both runs, which judged n_a
and n_b answers, all of its m misses fall on run b with probability C(n_b, m) / C(n_a + n_b, m). The product over the u
has to be below CHANCE, as after ten misses among as many answers. The rate of `stage` is unknown.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pandas as pd
from scipy.stats import hypergeom, median_abs_deviation

from bench.derived.measurements import HOT, INTERLEAVED, NULL_SOLVER, Measurements, at_tiers
from bench.derived.tiers import LANE, right, tier_settings
from bench.messages.columns import TYPICAL, Column, combined, worst
from bench.messages.task import Status, Tier
from bench.race_table import MISSES
from bench.report.words import joined, number, share
from bench.store import Run, RunError
from bench.timing.clock import Effort
from piezo_model.json_file import decoded
from solvers.protocol import setting_text

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
DRAWS, CHANCE = 1_000, 1e-3
"""Number of bootstrap samples, and the probability below which misses do not fall on one run by chance."""
FAILURES = {*Status} - {Status.ANSWERED, Status.UNSUPPORTED, Status.NOT_RUN}
SLOWER, FASTER, SAME, CANNOT_TELL = "slower", "faster", "no difference", "cannot tell"
BLOCK = ["timed", "digest", "scaling"]
SOLVER_LANE = ["solver", "lane"]
JOIN = ["digest", "scaling", "start", "solver", "lane", "settings"]
"""Columns by which rows of runs meet."""
YARDSTICK = "daqp"
"""The library to which others are compared."""
SHOWN = (
    Column("us", None, TYPICAL, "µs", number, of="answer_us"),
    Column("to_yardstick", None, TYPICAL, f"to {YARDSTICK}", number),
    Column("to_floor", None, TYPICAL, "to floor", number),
    Column("right", None, "sum", "right"),
    Column("miss_rate", None, worst, "misses, at most", share),
    Column("iterations", None, TYPICAL, "iters", number),
    Column("problems", None, "size", of="right"),
)
"""What is shown of a solver lane in each run."""


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
    """Ratio of the times of the reference workload that is timed beside the solvers."""
    lost: pd.DataFrame
    """LANE and ``tier``, one row per tier."""
    gained: pd.DataFrame
    failed: pd.DataFrame
    """SOLVER_LANE of those that fail where they did not, one row per lane."""
    alone: tuple[pd.DataFrame, pd.DataFrame]
    """Rows that only the first run has, and only the second."""

    @property
    def regressions(self) -> int:
        """Number of solver lanes that became slower or fail, plus tiers that were lost."""
        return self.count(SLOWER) + len(self.lost) + len(self.failed)

    @property
    def differences(self) -> int:
        """Number of regressions and improvements."""
        return self.regressions + self.count(FASTER) + len(self.gained)

    @property
    def moved(self) -> bool:
        """Whether the field as a whole changed unlike the reference workload, so that the cause is unknown."""
        return bool((np.abs(np.log(self.field.factor / self.sentinel)) > math.log(self.smallest)).any())

    @property
    def cannot_tell(self) -> bool:
        """Whether a change of times that matters may have gone unseen."""
        return self.moved or bool(self.count(CANNOT_TELL))

    def count(self, finding: str) -> int:
        """Number of solver lanes with this finding."""
        return int((self.times.finding == finding).sum())


@dataclass(frozen=True)
class Comparisons:
    """Several runs, and the changes from the first to each other one."""

    runs: Sequence[Run]
    lines: pd.DataFrame
    """``run``, its number, SOLVER_LANE and SHOWN, on what all have in common; see `side_by_side`."""
    common: pd.DataFrame
    """JOIN of the rows that all have."""
    pairs: list[Comparison]


def compare_runs(runs: Sequence[Run], smallest: float = SMALLEST) -> Comparisons:
    """Compare each other run with the first one; RunError if one is not a finished race, or runs have no row in common.
    ``smallest`` is above 1."""
    measurements = [Measurements.of(run) for run in runs]
    tables, pairs = [joinable(measured) for measured in measurements], []
    for run, rows in zip(runs[1:], tables[1:], strict=True):
        before, after = in_common([runs[0], run], [tables[0], rows])
        pairs.append(
            Comparison(
                runs[0],
                run,
                smallest,
                *compare_times(levels(before, after), smallest),
                float(run.sentinel_samples().level_ns.median() / runs[0].sentinel_samples().level_ns.median()),
                lost_tiers(before, after),
                lost_tiers(after, before),
                before[(before.status == Status.ANSWERED) & after.status.isin(FAILURES)][SOLVER_LANE].drop_duplicates(),
                (tables[0].drop(rows.index, errors="ignore"), rows.drop(tables[0].index, errors="ignore")),
            )
        )
    common = in_common(runs, tables)
    return Comparisons(runs, side_by_side(measurements, common), common[0][JOIN], pairs)


def joinable(measurements: Measurements) -> pd.DataFrame:
    """The rows of the field that were run, by JOIN, with the logarithm of the median time of update and solve for each
    way of timing, NaN for too few calls. Of a problem that is in two sets the first row counts. A default that is no
    rung of the ladder is taken for its first, so that it may reach a tier."""
    rows, fewest = measurements.lanes, Effort().fewest
    lanes = pd.MultiIndex.from_frame(rows[SOLVER_LANE])
    defaults = dict(zip(lanes[rows.is_default], rows.setting[rows.is_default], strict=True))
    requested = [beyond(setting, defaults.get(lane, "{}")) for setting, lane in zip(rows.setting, lanes, strict=True)]
    levels = {
        timed: [
            math.log(max(np.median(us), 1e-3)) if us.size >= fewest else math.nan
            for us in (measurements.pooled([task], timed) for task in rows.task)
        ]
        for timed in (HOT, INTERLEAVED)
    }
    rows = rows.assign(settings=requested, rung=rows.rung + 1, **levels)[rows.status != Status.NOT_RUN]
    return rows.drop_duplicates(JOIN).set_index(JOIN)


def beyond(setting: str, default: str) -> str:
    """What a setting requests beyond a default.

    Examples
    --------
    >>> beyond('{"eps": 1e-9, "verbose": false}', '{"verbose": false}')
    '{"eps": 1e-09}'
    """
    requested, fixed = (decoded(text, dict[str, Any]).items() for text in (setting, default))
    return setting_text(dict(item for item in requested if item not in fixed))


def in_common(runs: Sequence[Run], tables: Sequence[pd.DataFrame]) -> list[pd.DataFrame]:
    """The rows of each run whose keys all have, in the same order and with the names of the first one's problems and
    settings; if there are none, RunError that names the first column in which they differ."""
    common = set[tuple[str, ...]]()
    for count, name in enumerate(JOIN, 1):
        if not (common := set.intersection(*({key[:count] for key in table.index} for table in tables))):
            raise RunError(
                f"{joined(str(run.path) for run in runs)} have no row in common: rows meet by {joined(JOIN)}, and "
                f"these differ in {name}"
            )
    rows = [table.loc[sorted(common)] for table in tables]
    return [table.assign(**rows[0][["problem_set", "problem", "setting", "rung"]]).reset_index() for table in rows]


def levels(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """One row per answer and way of timing that both runs have: BLOCK, SOLVER_LANE, ``level_a`` and ``level_b``."""
    ok = before[(before.status == Status.ANSWERED) & (after.status == Status.ANSWERED)]
    tables = [ok.assign(timed=timed, level_a=ok[timed], level_b=after[timed]) for timed in (HOT, INTERLEAVED)]
    return pd.concat(
        [table for table in tables if (table.level_a - table.level_b).notna().any()] or tables[:1], ignore_index=True
    )


def side_by_side(measurements: Sequence[Measurements], rows: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """``run``, SOLVER_LANE and SHOWN on the rows that all runs have, at the setting with which the first run reaches
    1e-9 on most problems, from a cold start and on scaled problems if there are any.

    Parameters
    ----------
    measurements : sequence of Measurements
        Of each run.
    rows : sequence of DataFrame
        The rows of each that all have.
    """
    settings, form, tables = tier_settings(rows[0]), ["digest", "scaling"], []
    settings = settings[(settings.tier == Tier.HIGH) & (settings.scaling == rows[0].scaling.max())]
    for run, (measured, table) in enumerate(zip(measurements, rows, strict=True), 1):
        here = at_tiers(table[table.start == "cold"], settings, "furthest").query(f"tier == {str(Tier.HIGH)!r}")
        floor = measured.rows.query(f"solver == {NULL_SOLVER!r} and start == 'cold'").groupby(form).answer_us.first()
        yard = here[here.solver == YARDSTICK].set_index([*form, "lane"]).answer_us
        here = here.join(floor.rename("floor_us"), on=form).join(yard.rename("yard_us"), on=[*form, "lane"])
        shown = here.assign(
            iterations=here.iterations.where(here.iterations >= 0),
            to_floor=here.answer_us / here.floor_us,
            to_yardstick=here.answer_us / here.yard_us,
        )
        tables.append(combined(shown, SHOWN, SOLVER_LANE).assign(run=run))
    return pd.concat(tables, ignore_index=True)


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
    lanes = (own - own.groupby(level=BLOCK).transform("median")).groupby(level=["timed", *SOLVER_LANE])
    field = pd.DataFrame(
        {
            "factor": np.exp(own.groupby(level=BLOCK).median().groupby(level="timed").median()),
            "deviation": lanes.median().groupby(level="timed").agg(_deviation),
        }
    )
    chance, lines = np.random.default_rng(0), []
    for names, differences in lanes:
        known, deviation = differences.dropna(), float(field.deviation[cast(tuple[str, str, str], names)[0]])
        ends = interval(known.to_numpy(), deviation, chance)
        ratios = np.exp([known.median(), *ends])
        lines.append((*cast(tuple[str, str, str], names), known.size, *ratios, finding(*ends, deviation, smallest)))
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
    drawn = values[chance.integers(0, values.size, (DRAWS, values.size))]
    low, high = np.quantile(np.median(drawn, axis=1), (0.025, 0.975))
    return float(low) - WIDER * deviation, float(high) + WIDER * deviation


def _deviation(theta: pd.Series) -> float:
    least = ROUNDING if theta.count() >= ENOUGH_LANES else FEW_DEVIATE
    deviation = max(least, float(median_abs_deviation(theta, scale="normal", nan_policy="omit")))
    return deviation if theta.count() >= FEWEST_LANES else math.inf


def finding(low: float, high: float, deviation: float, smallest: float) -> str:
    """The finding of an interval of the logarithm of a ratio."""
    if low > 0.0 or high < 0.0:
        return SLOWER if low > 0.0 else FASTER
    return SAME if max(-low, high, deviation / SHARE) < math.log(smallest) else CANNOT_TELL


def lost_tiers(a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """LANE and ``tier`` of the tiers that rows a reach and rows b, the same tasks in the same order, do not."""
    both = tier_settings(a).merge(tier_settings(b), on=[*LANE, "tier"], suffixes=("", "_b"))
    both = both[(both.setting != "") & (both.setting_b == "")]
    return both.loc[[_is_lost(a, b, line) for line in both.to_dict("records")], [*LANE, "tier"]]


def _is_lost(a: pd.DataFrame, b: pd.DataFrame, line: Mapping[Hashable, object]) -> bool:
    names, tier = [*LANE, "setting"], Tier(str(line["tier"]))
    here = (a[names] == [line[name] for name in names]).all(axis=1) & (a.start == "cold")
    a, b = a[here], b[here]
    misses = b[MISSES[tier]] if tier in MISSES else 0
    by_chance = np.prod(hypergeom.pmf(misses, a.judged + b.judged, b.judged, misses))
    first = b.assign(timed_gap=math.nan, timed_violation=math.nan, timed_stage_excess=math.nan)
    return bool((right(a, tier) & ~right(first, tier)).any() or by_chance < CHANCE)
