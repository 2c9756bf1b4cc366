"""The measurements of a run, read once, and their rows at each tier.

Accuracy does not depend on the machine, so a setting is judged by the rows of all hosts; times are those of the host
with most rows. A measurement that was repeated in fresh processes has the medians of its times, the largest maximum,
the total number of samples and the spread of the solve,

    (max p50 − min p50) / median p50.

Its answer is that of the first repeat whose status is not ok, so that an occasional failure is not lost; a repeat that
was not run counts only if none was run.

Times are those of single calls, update plus solve, in tables, plots and decisions alike: a percentile of a solver is
taken over all its calls on all the problems in question. *Hot* calls follow each other directly; *in turns* with the
other solvers, each call finds the caches that they left.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from functools import cached_property
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.derived.accuracy import applies, measured, right, tainted
from bench.derived.table import ONESHOT
from bench.derived.tier_settings import LANE, tier_settings
from bench.messages.verdict import Status, Tier
from bench.store import Run, RunError
from bench.timing.schedule import PERIOD_US

FLOOR = "null"
"""Name of the solver that does nothing."""
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
    """A table of measurements and the raw times by task and repeat."""

    every: pd.DataFrame
    every_time: pd.DataFrame
    periods_us: Mapping[tuple[str, str], float] = dataclass_field(default_factory=dict)
    """Sampling periods of the problems in µs, by set and name; the paper's for any other."""

    @classmethod
    def of(cls, run: Run) -> Self:
        """Read those of a one-shot race; the paper's period counts where a problem's file is missing or damaged."""
        rows, periods = run.rows(ONESHOT), {}
        for name in dict.fromkeys(zip(rows.problem_set, rows.problem, strict=True)):
            with suppress(RunError):
                periods[name] = run.problem(*name).period_us
        return cls(rows, run.times(), periods)

    @cached_property
    def host(self) -> str:
        """The host with most rows."""
        return str(self.every.host.value_counts().index[0])

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of that host, one for all repeats, with ``total_us``, update plus solve, ``period_us``, the sampling
        period of the problem, and ``periods``, the time in such periods, or the steps of a method that takes one in
        each."""
        rows = over_repeats(tainted(self.every)[self.every.host == self.host])
        total, names = rows.update_us + rows.solve_us_p50, zip(rows.problem_set, rows.problem, strict=True)
        period = np.array([self.periods_us.get(name, PERIOD_US) for name in names])
        steps = rows.settings.str.contains('"steps"')
        return rows.assign(total_us=total, period_us=period, periods=rows.periods.where(steps, total / period))

    @property
    def shortest_period_us(self) -> float:
        """The shortest sampling period of the problems."""
        return float(self.rows.period_us.min()) if len(self.rows) else PERIOD_US

    @cached_property
    def times(self) -> pd.DataFrame:
        """The raw times of that host."""
        mine = self.every.loc[self.every.host == self.host, ["task", "repeat"]]
        return self.every_time.merge(mine.drop_duplicates(), on=["task", "repeat"])

    @cached_property
    def field(self) -> pd.DataFrame:
        """The rows of ladder settings and defaults, without the floor and the limits of iterations."""
        return self.rows[(self.rows.solver != FLOOR) & ((self.rows.rung >= 0) | self.rows.is_default)]

    @cached_property
    def settings(self) -> pd.DataFrame:
        """The setting of each tier."""
        return tier_settings(self.every[self.every.solver != FLOOR])

    @cached_property
    def tiers(self) -> pd.DataFrame:
        """The field's rows at each tier that a solver lane reaches, and at its defaults."""
        return at_tiers(self.field, self.settings)

    @cached_property
    def scaling(self) -> str:
        """The scaling of the first screen: the one with most rows, "scaled" in case of a tie."""
        counts = self.every.scaling.value_counts()
        return "scaled" if counts.empty or counts.get("scaled", 0) == counts.max() else str(counts.idxmax())

    @cached_property
    def problems(self) -> int:
        """Number of problems."""
        return int(self.rows.groupby(["problem_set", "problem"]).ngroups)


def at_tiers(rows: pd.DataFrame, settings: pd.DataFrame, column: str = "setting") -> pd.DataFrame:
    """The rows of each tier's setting and of the defaults, with ``tier`` and ``right``; an answer that is not right has
    the status missed.

    ``column`` names the setting's column: ``furthest`` gives a setting even if the tier is not reached.
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
    """One row per task, with the number of ``repeats`` that were run and ``solve_us_spread``."""
    rows = measured(rows)
    if not (rows.repeat > 0).any():
        return rows.assign(repeats=1, solve_us_spread=np.nan)
    groups = rows.sort_values("repeat").groupby("task", sort=False)
    answers = (
        rows.assign(ok=rows.status == Status.OK)
        .sort_values(["ok", "repeat"])
        .groupby("task", sort=False)
        .head(1)
        .set_index("task")
    )
    p50 = groups.solve_us_p50
    merged = answers.drop(columns="ok").assign(
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
"""Ways of timing, with the prefix of the names under which a run stores the times."""


def by_task(times: pd.DataFrame, ways: Iterable[str] = ("hot",)) -> dict[str, list[Microseconds]]:
    """Times of the calls of each task, update plus solve, in µs; the median update is added if updates were timed
    separately."""
    calls: dict[str, list[Microseconds]] = {}
    for way in ways:
        updates, solves = (
            times[times.what == WAYS[way] + what].set_index(["task", "repeat"]).ns for what in ("update", "solve")
        )
        for key in solves.index:
            solve = np.asarray(solves[key], dtype=np.float64) / 1e3
            update = np.asarray(updates.get(key, ()), dtype=np.float64) / 1e3
            if solve.size:
                calls.setdefault(key[0], []).append(
                    solve + (update if update.size == solve.size else np.median(update) if update.size else 0.0)
                )
    return calls


def pooled(calls: dict[str, list[Microseconds]], tasks: Iterable[str]) -> Microseconds:
    """The times of some tasks, each counted once."""
    parts = [part for task in dict.fromkeys(tasks) for part in calls.get(task, [])]
    return np.concatenate(parts) if parts else np.zeros(0)
