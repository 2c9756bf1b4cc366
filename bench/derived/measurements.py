"""The measurements of a run, read once, and what is said of them at each tier.

Accuracy is the same wherever it was measured, so a setting is judged by the rows of all hosts; times are those of one
host, the one with most rows. A measurement that was repeated in fresh processes has the medians of its times, the
largest maximum, the sum of its samples and the spread

    (max p50 − min p50) / median p50

of the solve. What is said of its answer is that of the first repeat that is not ok, so that nothing which goes wrong
now and then is lost; a repeat in which it was not run counts only where it was run in none.

What answers took is told call by call, update and solve together, the same in tables, plots and decisions: a percentile
of a solver is that of all its calls on all the problems in question. Hot calls follow each other; in turns each finds
the caches that the other solvers left.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.derived.accuracy import applies, measured, right, tainted
from bench.derived.tier_settings import LANE, tier_settings
from solvers import Status, Tier

FLOOR = "null"
"""The solver that does nothing."""
MEDIANS = [
    "setup_us",
    "update_us",
    "solve_us_p50",
    "solve_us_p50_low",
    "solve_us_p50_high",
    "solve_us_p99",
    "solve_us_p99_low",
    "solve_us_p99_high",
    "interleaved_us_p50",
    "interleaved_us_p99",
    "periods",
    "reported_us",
]
WORST = ["cost_gap", "violation", "timed_gap", "stage_excess"]


@dataclass(frozen=True)
class Measurements:
    """A table of measurements, one row each, with the raw times by task and repeat."""

    every: pd.DataFrame
    every_time: pd.DataFrame

    @cached_property
    def host(self) -> str:
        """The host with most rows."""
        return str(self.every.host.value_counts().index[0])

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of that host, one for all repeats, with ``total_us``, update and solve."""
        rows = over_repeats(tainted(self.every)[self.every.host == self.host])
        return rows.assign(total_us=rows.update_us + rows.solve_us_p50)

    @cached_property
    def times(self) -> pd.DataFrame:
        """The raw times of that host."""
        mine = self.every.loc[self.every.host == self.host, ["task", "repeat"]]
        return self.every_time.merge(mine.drop_duplicates(), on=["task", "repeat"])

    @cached_property
    def field(self) -> pd.DataFrame:
        """Settings and defaults, without the floor and limits of iterations."""
        return self.rows[(self.rows.solver != FLOOR) & ((self.rows.rung >= 0) | self.rows.is_default)]

    @cached_property
    def settings(self) -> pd.DataFrame:
        """Which setting stands for which tier."""
        return tier_settings(self.every[self.every.solver != FLOOR])

    @cached_property
    def tiers(self) -> pd.DataFrame:
        """The field at each tier that a solver lane reaches and at the default."""
        return at_tiers(self.field, self.settings)

    @cached_property
    def scaling(self) -> str:
        """The scaling of the first screen, in which most settings were measured; that of the scaled data where there
        is no difference."""
        counts = self.every.scaling.value_counts()
        return "scaled" if counts.empty or counts.get("scaled", 0) == counts.max() else str(counts.idxmax())

    @cached_property
    def problems(self) -> int:
        """How many there are."""
        return int(self.rows.groupby(["problem_set", "problem"]).ngroups)


def at_tiers(rows: pd.DataFrame, settings: pd.DataFrame, column: str = "setting") -> pd.DataFrame:
    """The rows of the settings that stand for tiers, once for each, and of the default, with ``tier`` and ``right``.

    An answer that is not right has missed its tier. ``column`` is the setting that is taken: ``furthest`` takes one
    where the tier is not reached, too.
    """
    chosen = settings.loc[settings[column] != "", [*LANE, "tier", column]].rename(columns={column: "setting"})
    parts = [
        _judged(part, Tier(str(tier)))
        for tier, part in rows.merge(chosen, on=[*LANE, "setting"]).groupby("tier", sort=False)
    ]
    return pd.concat(
        [*parts, _judged(rows[rows.is_default].assign(tier=str(Tier.DEFAULT)), Tier.DEFAULT)], ignore_index=True
    )


def _judged(rows: pd.DataFrame, tier: Tier) -> pd.DataFrame:
    rows = rows[applies(rows, tier)]
    is_right = right(rows, tier)
    return rows.assign(
        right=is_right, status=rows.status.mask((rows.status == Status.OK) & ~is_right, str(Status.MISSED))
    )


def over_repeats(rows: pd.DataFrame) -> pd.DataFrame:
    """One row a task, with ``repeats``, of which it was run, and ``solve_us_spread``."""
    rows = measured(rows)
    if not (rows.repeat > 0).any():
        return rows.assign(repeats=1, solve_us_spread=np.nan)
    groups = rows.sort_values("repeat").groupby("task", sort=False)
    said = (
        rows.assign(ok=rows.status == Status.OK)
        .sort_values(["ok", "repeat"])
        .groupby("task", sort=False)
        .head(1)
        .set_index("task")
    )
    p50 = groups.solve_us_p50
    merged = said.drop(columns="ok").assign(
        **{name: groups[name].median() for name in MEDIANS},
        **{name: groups[name].max() for name in [*WORST, "solve_us_max"]},
        samples=groups.samples.sum(),
        preemptions=groups.preemptions.sum(),
        mutates_input=groups.mutates_input.any(),
        repeatable=groups.repeatable.all(),
        repeats=groups.size(),
        solve_us_spread=(p50.max() - p50.min()) / p50.median(),
    )
    return merged.reset_index().sort_index(axis=0)[[*rows.columns, "repeats", "solve_us_spread"]]


Microseconds = NDArray[np.float64]
WAYS = {"hot": "", "in turns": "interleaved_"}
"""How calls are timed, and how the names begin under which a run keeps the times."""


def by_task(times: pd.DataFrame, ways: Iterable[str] = ("hot",)) -> dict[str, list[Microseconds]]:
    """Update and solve together by task, µs; where updates were timed apart, their median is added."""
    found: dict[str, list[Microseconds]] = {}
    for way in ways:
        updates, solves = (
            times[times.what == WAYS[way] + what].set_index(["task", "repeat"]).ns for what in ("update", "solve")
        )
        for key in solves.index:
            solve = np.asarray(solves[key], dtype=np.float64) / 1e3
            update = np.asarray(updates.get(key, ()), dtype=np.float64) / 1e3
            if solve.size:
                found.setdefault(key[0], []).append(
                    solve + (update if update.size == solve.size else np.median(update) if update.size else 0.0)
                )
    return found


def pooled(found: dict[str, list[Microseconds]], tasks: Iterable[str]) -> Microseconds:
    """Those of some tasks, each counted once."""
    parts = [part for task in dict.fromkeys(tasks) for part in found.get(task, [])]
    return np.concatenate(parts) if parts else np.zeros(0)
