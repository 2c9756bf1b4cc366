"""Two runs against each other: what became faster or slower, more or less accurate, came, went or changed its status.

A row of one run is compared with that of the other at the same setting. Times are compared solver lane by solver lane, and row by row
only in those that differ; see `lines`. Which tiers a solver lane reaches follows from its rows; see `tiers`.

The accuracy of the first answer is exact, so it needs no statistics: a row is more or less accurate where its cost gap differs by
more than a factor of GAP_FACTOR and the larger one is above LEAST_GAP.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pandas as pd

from bench.comparison import tiers
from bench.comparison.levels import FEWEST, NAMES, log_ratios, sentinel_level
from bench.comparison.lines import CANNOT_TELL, CHANGES, WITNESSES, Times, compare_times
from bench.derived.accuracy import tainted
from bench.derived.measurements import over_repeats
from bench.derived.table import ONESHOT
from bench.races import null_solver
from bench.report.words import joined, marked, solver_lanes
from bench.store import Run, RunError
from solvers import Status

GAP_FACTOR = 10.0
LEAST_GAP = 1e-12
SMALLEST = 1.2
"""Smallest ratio of times that matters, unless the user says otherwise."""
MANY = 1.0 / 3.0
"""Share of the solver lanes that differ above which what all share may be theirs and not the machine's."""
OTHER_KINDS = ("less accurate", "more accurate", "status changed", "gone", "new")
"""What may change in a row beside its time."""
WORSE = ("less accurate", "gone")
PREDICATES = {"status changed": ("changed status", "changed status"),
              **{kind: (f"is {kind}", f"are {kind}") for kind in OTHER_KINDS if kind != "status changed"}}
"""How a sentence says it of one solver lane and of several."""
MOST_NAMED = 6
"""Solver lanes that have a sentence each."""
IGNORED = ("effort", "time_limit_s", "memory_mb", "solver_files")
"""Settings that change nothing of what is compared, or which the time itself shows."""


@dataclass(frozen=True)
class RunComparison:
    """What changed from run a to run b."""

    a: Run
    b: Run
    warnings: tuple[str, ...]
    """Why the two may not be comparable."""
    notes: tuple[str, ...]
    """Versions that differ."""
    doubts: tuple[str, ...]
    """Why what all solvers share may be theirs and not the machine's."""
    times: Times
    rows: pd.DataFrame
    """One row a task of either run: names, ``timed`` (how), ``ratio``, ``ratio_low``, ``ratio_high``, ``adjusted``, ``gap_a``, ``gap_b``,
    ``status_a``, ``status_b``, ``changes`` (of CHANGES and OTHER_KINDS) and ``regression`` (worse otherwise than by its time)."""
    tiers: pd.DataFrame
    """One row a scaling, solver lane and tier that one of the runs reaches; see `compare_tiers`."""

    @property
    def changed(self) -> pd.DataFrame:
        """Rows with any change."""
        return self.rows[self.rows.changes.map(len) > 0]

    @property
    def regressions(self) -> int:
        """Solver lanes that became slower, rows that became worse otherwise, and tiers that were lost otherwise than by chance."""
        return self.times.lanes("slower") + int(self.rows.regression.sum()) + self._tiers(tiers.LOST)

    @property
    def differences(self) -> int:
        """Solver lanes that became slower or faster, rows with any other change, and tiers lost or gained otherwise than by chance."""
        return self.times.differ + len(self._with(*OTHER_KINDS)) + self._tiers(tiers.LOST, tiers.GAINED)

    @property
    def cannot_tell(self) -> bool:
        """Whether a change of times that matters may have gone unseen."""
        untimed, timed = self._untimed, self.rows[self.rows.ratio.notna()]
        right = untimed[(untimed.status_a == Status.OK) & (untimed.status_b == Status.OK)]
        hidden = set(zip(right.solver, right.lane, strict=True)) - set(zip(timed.solver, timed.lane, strict=True))
        return bool(self.doubts or self.times.lanes(CANNOT_TELL) or hidden)

    @property
    def _untimed(self) -> pd.DataFrame:
        """Rows of both runs, but for the floor, whose times are not compared."""
        rows = self.rows[self.rows.solver != null_solver.ENTRY.name]
        return rows[rows.ratio.isna() & (rows.in_run == "both")]

    def _tiers(self, *changes: str) -> int:
        return int((self.tiers.change.isin(changes) & ~self.tiers.by_chance).sum())

    def _with(self, *kinds: str) -> pd.DataFrame:
        return self.rows[self.rows.changes.map(lambda changes: bool(set(changes) & set(kinds)))]

    @property
    def verdict(self) -> list[str]:
        """In words: "no difference", or one sentence a solver lane and kind of change."""
        names = f"{self.b.path.name} against {self.a.path.name}"
        untimed = len(self._untimed)
        left_out = [f"The times of {untimed} rows are not compared, since one of the runs timed them fewer than {FEWEST} times."] if untimed else []
        if not self.differences:
            unseen = ", though some may have gone unseen" if self.cannot_tell else ""
            return [f"{names}: no difference in {len(self.rows)} rows{unseen}.", *self.times.sentences(), *left_out]
        other = [f"{len(self._with(*OTHER_KINDS))} of {len(self.rows)} rows in something else"]
        if changed := self._tiers(tiers.LOST, tiers.GAINED):
            other.append(f"{changed} of {len(self.tiers)} tiers in whether {'it is' if changed == 1 else 'they are'} reached")
        sentences = [f"{names}: {joined([solver_lanes(self.times.differ, verb='differ') + ' in time', *other])}.",
                     *self.times.sentences(), *tiers.sentences(self.tiers)]
        for kind in OTHER_KINDS:
            sentences += self._said_of(kind)
        return sentences + left_out

    def _said_of(self, kind: str) -> list[str]:
        """One sentence a solver lane, or one for all where they are many."""
        those = self._with(kind)
        lanes = those.groupby(["solver", "lane"], sort=False)
        if len(lanes) > MOST_NAMED:
            most = [f"{marked(solver)} ({lane})" for solver, lane in lanes.size().sort_values(ascending=False, kind="stable").index[:3]]
            return [f"{solver_lanes(len(lanes))} {PREDICATES[kind][1]} in {len(those)} rows{_how(kind, those)}; most of these rows are of "
                    f"{', '.join(most)}."]
        rows = self.rows.groupby(["solver", "lane"]).size().to_dict()
        return [f"{marked(str(solver))} ({lane}) {PREDICATES[kind][0]} in {len(part)} of {rows[solver, lane]} rows{_how(kind, part)}."
                for (solver, lane), part in lanes]


def _how(kind: str, those: pd.DataFrame) -> str:
    if kind == "status changed":
        first = those.iloc[0]
        return f", for example from {first.status_a} to {first.status_b}"
    if kind.endswith("accurate"):
        worst = those.loc[(np.log10(those.gap_b) - np.log10(those.gap_a)).abs().idxmax()]
        return f", at worst from a cost gap of {worst.gap_a:.1e} to {worst.gap_b:.1e}"
    return ""


def compare_runs(a: Run, b: Run, smallest: float = SMALLEST) -> RunComparison:
    """Compare run b with run a; RunError where one is not a finished one-shot race.

    Ratios of times that matter begin at ``smallest``, which is above 1.
    """
    for run in (a, b):
        if (race := run.settings.get("race", "oneshot")) != "oneshot":
            raise RunError(f"{run.path} is a {race} race, and only one-shot races can be compared")
    warnings, notes = _conditions(a.settings, b.settings)
    times = compare_times(log_ratios(a, b), null_solver.ENTRY.name, smallest)
    first, second = (over_repeats(tainted(run.rows(ONESHOT))) for run in (a, b))
    of_tiers = tiers.compare_tiers(first, second)
    rows = _matched(first, second).merge(times.rows, on="task", how="left")
    records = cast(list[dict[str, Any]], rows.to_dict("records"))
    changes = [_changes(row) for row in records]
    rows["changes"] = changes
    rows["regression"] = [bool(set(found) & set(WORSE)) or _broke(row) for found, row in zip(changes, records, strict=True)]
    return RunComparison(a, b, warnings, (*notes, *tiers.notes(of_tiers)), tuple(_doubts(a, b, times, smallest)), times, rows, of_tiers)


def _doubts(a: Run, b: Run, times: Times, smallest: float) -> list[str]:
    """Why what all solvers share may be theirs and not the machine's."""
    found, work = [], sentinel_level(b) / sentinel_level(a)
    if 0 < times.witnesses < WITNESSES:
        found.append(f"Only {times.witnesses} solvers have times in both runs, counting the one that does nothing: too few to tell a change "
                     "of the machine from a change of theirs.")
    lanes = times.lines.groupby(["solver", "lane"]).ngroups
    if times.differ > MANY * lanes:
        found.append(f"{solver_lanes(times.differ, lanes, 'differ')} from the median of the field. With so many, that median, which is "
                     "taken for the change of the machine, may have moved with them.")
    found += [f"{str(timed).capitalize()}, the field as a whole changed by a factor of {ratio:.2f}, and the fixed piece of work timed beside it by "
              f"{work:.2f}: either the machine changed in a way that this work does not feel, or most solvers did."
              for timed, ratio in times.machine.items() if abs(np.log(ratio / work)) > np.log(smallest)]
    return found


def _conditions(a: Mapping[str, Any], b: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences on machines and settings that differ, and on versions."""
    warnings, notes = [], []
    for what in ("processor", "cores", "system", "python"):
        first, second = a["machine"].get(what), b["machine"].get(what)
        if first != second:
            warnings.append(f"Different machines: {what} is {first} in the first run and {second} in the second; times cannot be compared.")
    for name in sorted(set(a["settings"]) | set(b["settings"])):
        first, second = _said(a["settings"].get(name)), _said(b["settings"].get(name))
        if first != second and name not in IGNORED:
            warnings.append(f"Different settings: {name} is {first} in the first run and {second} in the second.")
    efforts = [run["settings"].get("effort") or {} for run in (a, b)]
    warnings += [f"Different timing effort: {name} is {efforts[0].get(name)} in the first run and {efforts[1].get(name)} in the second."
                 for name in sorted(efforts[0].keys() | efforts[1].keys()) if efforts[0].get(name) != efforts[1].get(name)]
    for title, first, second in (("package", a["machine"].get("versions", {}), b["machine"].get("versions", {})),
                                 ("solver", a.get("field", {}), b.get("field", {}))):
        notes += [f"The {title} {name} is {first[name]} in the first run and {second[name]} in the second."
                  for name in sorted(first.keys() & second.keys()) if first[name] != second[name]]
    return tuple(warnings), tuple(notes)


def _said(value: Any) -> str:
    """A setting in words; the order in a list means nothing."""
    return (", ".join(sorted(map(str, value))) or "all") if isinstance(value, list) else str(value)


def _matched(a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """The rows of both runs side by side, with NaN where one has none; without those that one of them did not run.

    Why a setting was not run is in the row of a looser one: a crash in its status, a slow answer in its times.
    """
    columns = ["task", *NAMES, "status", "cost_gap"]
    both = a[columns].merge(b[columns], on=NAMES, how="outer", suffixes=("_a", "_b"), indicator="in_run")
    both = both[(both.status_a != Status.NOT_RUN) & (both.status_b != Status.NOT_RUN)]
    both = both.rename(columns={"cost_gap_a": "gap_a", "cost_gap_b": "gap_b"}).assign(task=both.task_a.fillna(both.task_b))
    return both.assign(in_run=both.in_run.astype(str), status_a=both.status_a.fillna(""), status_b=both.status_b.fillna(""))


def _changes(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Everything that changed in a row, of CHANGES and OTHER_KINDS."""
    if row["in_run"] != "both":
        return ("gone",) if row["in_run"] == "left_only" else ("new",)
    found = [row["change"]] if row["change"] in CHANGES else []
    gaps = (row["gap_a"], row["gap_b"])
    if max(gaps) > LEAST_GAP and max(gaps) > GAP_FACTOR * min(gaps):
        found.append("less accurate" if gaps[1] > gaps[0] else "more accurate")
    if row["status_a"] != row["status_b"]:
        found.append("status changed")
    return tuple(found)


def _broke(row: Mapping[str, Any]) -> bool:
    """Whether a row was right and is so no more."""
    return bool(row["status_a"] == Status.OK and row["status_b"] != Status.OK)
