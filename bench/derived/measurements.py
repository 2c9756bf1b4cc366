"""The table of a race, from which all results are derived: its columns, the measurements of a run, read once,
and their rows at each tier.

Accuracy does not depend on the machine, so a setting is judged by the rows of all hosts; times are those of the host
with most rows. All rows of a solver at one setting on one problem become one: repeats in fresh processes, and hot,
long, interleaved and scheduled calls. It has the medians of the times, the largest maximum, the total number of
samples, and the spread of the answer over the repeats,

    (max − min) / median.

Its answer is that of the first row whose status is not answered, so that an occasional failure is not lost, and its
gaps are the largest of all rows; a row that was not run counts only if none was run.

*Hot* calls follow each other directly, and a longer measurement of them replaces a shorter one. *Interleaved* calls
alternate with those of other solvers, and find the caches that these left. *Scheduled* calls come at 8 kHz, as in a
controller (`bench.derived.schedule`). Both count as no shorter than the median of hot ones, whose processor time is
checked over many calls. A percentile of a solver is taken over all its calls on all the problems in question.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.derived.tiers import LANE, applies, distance, measured, right, supported, tier_settings
from bench.messages.task import Status, Tier, Timed
from bench.race_table import MISSES
from bench.store import Run
from bench.timing.clock import answers_us
from bench.timing.percentiles import rate_bound
from bench.timing.schedule import PERIOD_US

NULL_SOLVER = "null"
"""Name of the solver that does nothing."""
MEDIANS = ["setup_us", "update_us", "solve_us_p50", "solve_us_p99", "answer_us", "cpu_us", "periods", "reported_us"]
WORST = ["cost_gap", "violation", "timed_gap", "timed_violation", "stage_excess", "timed_stage_excess"]
HOT, INTERLEAVED, SCHEDULED = "hot", "interleaved", "scheduled"
MEASUREMENT = ["task", "timed", "repeat"]
"""Columns that identify a measurement in the tables of rows and of times of one host."""
Microseconds = NDArray[np.float64]


@dataclass(frozen=True)
class Measurements:
    """A table of measurements and their raw times."""

    all_rows: pd.DataFrame
    raw_times: pd.DataFrame
    own: Mapping[str, float] = field(default_factory=dict)
    """The solver lanes of the user's own files, each with the error that it states."""

    @classmethod
    def of(cls, run: Run) -> Self:
        """Read those of a finished run."""
        return cls(run.rows(), run.times(), run.settings.get("own", {}))

    def is_own(self, rows: pd.DataFrame) -> pd.Series[bool]:
        """Whether each row is of the user's own files."""
        return (rows.solver + " (" + rows.lane + ")").isin([*self.own])

    @cached_property
    def host(self) -> str:
        """The host with most rows."""
        return str(self.all_rows.host.value_counts().index[0])

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of that host, one for all repeats and ways of timing."""
        return merged(self.all_rows[self.all_rows.host == self.host])

    @property
    def shortest_period_us(self) -> float:
        """The shortest sampling period of the problems."""
        return float(self.rows.period_us.min()) if len(self.rows) else PERIOD_US

    @cached_property
    def calls(self) -> dict[tuple[str, str], Microseconds]:
        """Times of an answer in all calls of that host, by task and by HOT or INTERLEAVED."""
        rows = self.all_rows[(self.all_rows.host == self.host) & (self.all_rows.samples > 0)]
        hot_us = self.rows.set_index("task").answer_us
        raw = self.raw_times.set_index([*MEASUREMENT, "what"]).ns.unstack().reset_index()
        times: dict[tuple[str, str], list[Microseconds]] = {}
        for line in rows[~_is_replaced(rows)].merge(raw, on=MEASUREMENT).to_dict("records"):
            timed = line["timed"] if line["timed"] in (INTERLEAVED, SCHEDULED) else HOT
            us = answers_us(line["update"], line["solve"], line["cpu_us"])
            times.setdefault((line["task"], timed), []).append(
                us if timed == HOT else np.fmax(us, hot_us[line["task"]])
            )
        return {key: np.concatenate(calls) for key, calls in times.items()}

    def pooled(self, tasks: Iterable[str], *timings: str) -> Microseconds:
        """The times of some tasks, each counted once."""
        keys = ((task, timed) for task in dict.fromkeys(tasks) for timed in timings or (HOT,))
        return np.concatenate([np.zeros(0), *(self.calls[key] for key in keys if key in self.calls)])

    @cached_property
    def lanes(self) -> pd.DataFrame:
        """The rows without those of the floor."""
        return self.rows[self.rows.solver != NULL_SOLVER]

    @cached_property
    def settings(self) -> pd.DataFrame:
        """The setting of each tier."""
        return tier_settings(self.all_rows[self.all_rows.solver != NULL_SOLVER])

    @cached_property
    def rows_at_tiers(self) -> pd.DataFrame:
        """The field's rows at each tier that a solver lane reaches, and at its defaults."""
        return at_tiers(self.lanes, self.settings)

    def first_screen(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Those rows that are of the first screen: from a cold start, in its scaling."""
        return rows[(rows.start == "cold") & (rows.scaling == self.scaling)]

    @cached_property
    def scaling(self) -> str:
        """The scaling of the first screen: the one with most rows, "scaled" in case of a tie."""
        counts = self.all_rows.scaling.value_counts()
        return "scaled" if counts.empty or counts.get("scaled", 0) == counts.max() else str(counts.idxmax())

    @cached_property
    def problems(self) -> int:
        """Number of problems."""
        return int(self.rows.groupby(["problem_set", "problem"]).ngroups)


def at_tiers(rows: pd.DataFrame, settings: pd.DataFrame, column: str = "setting") -> pd.DataFrame:
    """The rows of each tier's setting and of the defaults, with ``tier``, ``right`` and ``gap``, their distance, NaN if
    that is infinite; an answer that is not right has the status missed.

    ``column`` names the setting's column: ``furthest`` gives a setting even if the tier is not reached.
    """
    rows, chosen = (
        supported(rows),
        settings.loc[settings[column] != "", [*LANE, "tier", column]].rename(columns={column: "setting"}),
    )
    tables = [
        _judged(group, Tier(str(tier)))
        for tier, group in rows.merge(chosen, on=[*LANE, "setting"]).groupby("tier", sort=False)
    ]
    return pd.concat(
        [*tables, _judged(rows[rows.is_default].assign(tier=str(Tier.DEFAULT)), Tier.DEFAULT)], ignore_index=True
    )


def _judged(rows: pd.DataFrame, tier: Tier) -> pd.DataFrame:
    rows = rows[applies(rows, tier)]
    is_right, missed = right(rows, tier), rows[MISSES.get(tier, MISSES[Tier.LOW])]
    return rows.assign(
        miss_rate=math.nan if tier is Tier.STAGE else rate_bound(missed, rows.judged),
        right=is_right,
        gap=distance(rows).replace(np.inf, np.nan),
        status=rows.status.mask((rows.status == Status.ANSWERED) & ~is_right, str(Status.MISSED)),
    )


def merged(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per task, with the number of ``repeats`` that were run, ``answer_us_spread`` and ``interleaved_us``."""
    rows = measured(rows)
    order = rows.assign(ok=rows.status == Status.ANSWERED, way=rows.timed.map([*get_args(Timed)].index))
    answers = order.sort_values(["ok", "repeat", "way"]).groupby("task", sort=False).head(1)
    every, apart = rows.groupby("task", sort=False), rows.timed.isin([INTERLEAVED, SCHEDULED])
    times = rows[~_is_replaced(rows) & ~apart].groupby("task", sort=False)
    us = times.answer_us
    tasks = answers.set_index("task").assign(
        **{name: times[name].median() for name in MEDIANS},
        **{name: every[name].max() for name in WORST},
        solve_us_max=times.solve_us_max.max(),
        samples=times.samples.sum(),
        **{name: every[name].sum() for name in ("judged", *MISSES.values())},
        preemptions=every.preemptions.sum(),
        mutates_input=every.mutates_input.any(),
        repeatable=every.repeatable.all(),
        repeats=times.size(),
        answer_us_spread=((us.max() - us.min()) / us.median()).where(times.size() > 1),
        interleaved_us=rows.answer_us.clip(lower=rows.task.map(us.median()))[rows.timed == INTERLEAVED]
        .groupby(rows.task)
        .median(),
    )
    tasks = tasks.drop(columns=["ok", "way"]).reset_index().set_axis(answers.index).sort_index()
    return tasks[[*rows.columns, "repeats", "answer_us_spread", "interleaved_us"]]


def _is_replaced(rows: pd.DataFrame) -> pd.Series[bool]:
    """Whether a hot measurement was repeated with more calls."""
    same = [rows[name] for name in ("task", "repeat", "host")]
    longer = (rows.timed == "long") & (rows.samples > 0)
    return (rows.timed == HOT) & longer.groupby(same).transform("any")
