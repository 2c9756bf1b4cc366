"""Two runs against each other: what became faster or slower, more or less accurate, came, went or changed its status.

Times are compared row by row by paired log-ratios with a noise band (`paired`, `compare_rows`): those of interleaved turns where
both runs have them, else hot solves; all p-values together are corrected by Benjamini and Hochberg. The interval of a
ratio is exp(θ ± t √(s² + τ²)), t of Student's distribution at 97.5 %.

Accuracy is exact, so it needs no statistics: a row is more or less accurate where its cost gap differs by more than a factor of
GAP_FACTOR and the larger one is above LEAST_GAP.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pandas as pd
from scipy.stats import t as student

from bench.comparison.matched import FEWEST, LEVEL, NAMES, WITNESSES, Comparison, compare, effects_of
from bench.comparison.paired import benjamini_hochberg
from bench.races.oneshot.rows import ONESHOT
from bench.store import Run, RunError
from solvers import Status

GAP_FACTOR = 10.0
LEAST_GAP = 1e-12
KINDS = ("slower", "faster", "less accurate", "more accurate", "status changed", "gone", "new")
WORSE = ("slower", "less accurate", "gone")
VERBS = {"status changed": "of another status"}
"""How a sentence says it, where not by the name of the kind."""
MOST_NAMED = 6
"""Solver lanes that have a sentence each."""
TIMES = ("interleaved_solve", "solve")
IGNORED = ("effort", "time_limit_s", "memory_mb", "solver_files")
"""Settings that change nothing of what is compared, or which the time itself shows."""


@dataclass(frozen=True)
class RunComparison:
    """What changed from run a to run b.

    Attributes
    ----------
    a, b : Run
    warnings : tuple of str
        Why the two may not be comparable.
    notes : tuple of str
        Versions that differ, and what the times cannot tell.
    rows : DataFrame
        One row a row of either run: names, ``ratio``, ``ratio_low``, ``ratio_high``, ``adjusted``, ``timed`` (which times),
        ``gap_a``, ``gap_b``, ``status_a``, ``status_b``, ``changes`` (of KINDS) and ``regression``.
    noise : dict of str to float
        Noise band by which times.
    """

    a: Run
    b: Run
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    rows: pd.DataFrame
    noise: Mapping[str, float]

    def count(self, kind: str) -> int:
        """Rows with a change of that kind."""
        return int(self.rows.changes.map(lambda changes: kind in changes).sum())

    @property
    def changed(self) -> pd.DataFrame:
        """Rows with any change."""
        return self.rows[self.rows.changes.map(len) > 0]

    @property
    def regressions(self) -> pd.DataFrame:
        """Rows that became worse."""
        return self.rows[self.rows.regression]

    @property
    def verdict(self) -> list[str]:
        """In words: "no difference", or one sentence a solver lane and kind of change."""
        names = f"{self.b.path.name} against {self.a.path.name}"
        untimed = int((self.rows.ratio.isna() & (self.rows.in_run == "both")).sum())
        left_out = [f"The times of {untimed} rows are not compared, since a run has fewer than {FEWEST} of them."] if untimed else []
        if self.changed.empty:
            return [f"{names}: no difference in {len(self.rows)} rows.", *left_out]
        sentences = [f"{names}: {len(self.changed)} of {len(self.rows)} rows differ."]
        for kind in KINDS:
            sentences += self._said_of(kind)
        return sentences + left_out

    def _said_of(self, kind: str) -> list[str]:
        """One sentence a solver lane, or one for all where they are many."""
        those = self.rows[self.rows.changes.map(lambda changes: kind in changes)]
        lanes = those.groupby(["solver", "lane"], sort=False)
        if len(lanes) > MOST_NAMED:
            most = [f"{solver} ({lane})" for solver, lane in lanes.size().sort_values(ascending=False, kind="stable").index[:3]]
            return [f"{len(lanes)} solver lanes are {VERBS.get(kind, kind)} in {len(those)} rows{_how(kind, those)}, the most of them "
                    f"of {', '.join(most)}."]
        rows = self.rows.groupby(["solver", "lane"]).size().to_dict()
        return [f"{solver} ({lane}) is {VERBS.get(kind, kind)} in {len(part)} of {rows[solver, lane]} rows{_how(kind, part)}."
                for (solver, lane), part in lanes]


def _how(kind: str, those: pd.DataFrame) -> str:
    if kind in ("slower", "faster"):
        return f", by {100.0 * (float(those.ratio.median()) - 1.0):+.1f} % in the median of these"
    if kind == "status changed":
        first = those.iloc[0]
        return f", such as from {first.status_a} to {first.status_b}"
    if kind.endswith("accurate"):
        worst = those.loc[(np.log10(those.gap_b) - np.log10(those.gap_a)).abs().idxmax()]
        return f", at most from a cost gap of {worst.gap_a:.1e} to {worst.gap_b:.1e}"
    return ""


def compare_runs(a: Run, b: Run) -> RunComparison:
    """Compare run b with run a.

    Raises
    ------
    RunError
        Where a run is not a finished one-shot race.
    """
    for run in (a, b):
        if (race := run.settings.get("race", "oneshot")) != "oneshot":
            raise RunError(f"{run.path}: is a race of the kind {race!r}, and only one-shot races can be compared row by row")
    warnings, notes = _conditions(a.settings, b.settings)
    rows = _matched(a.rows(ONESHOT), b.rows(ONESHOT))
    times, noise = _times(a, b)
    rows = rows.merge(times, on="task", how="left")
    if 0 < (count := rows[rows.ratio.notna()].solver.nunique()) < WITNESSES:
        notes += (f"Only {count} solvers, the one that does nothing among them, have times in both runs: what the machine changed "
                  "cannot be told from what they changed.",)
    records = cast(list[dict[str, Any]], rows.to_dict("records"))
    changes = [_changes(row) for row in records]
    rows["changes"] = changes
    rows["regression"] = [bool(set(found) & set(WORSE)) or _broke(row) for found, row in zip(changes, records, strict=True)]
    return RunComparison(a, b, warnings, notes, rows, noise)


def _conditions(a: Mapping[str, Any], b: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences on machines and settings that differ, and on versions."""
    warnings, notes = [], []
    for what in ("processor", "cores", "system", "python"):
        first, second = a["machine"].get(what), b["machine"].get(what)
        if first != second:
            warnings.append(f"Different machines: {what} {first} and {second}; times cannot be compared.")
    for name in sorted(set(a["settings"]) | set(b["settings"])):
        first, second = _said(a["settings"].get(name)), _said(b["settings"].get(name))
        if first != second and name not in IGNORED:
            warnings.append(f"Different settings: {name} {first} and {second}.")
    efforts = [run["settings"].get("effort") or {} for run in (a, b)]
    warnings += [f"Different effort of timing: {name} {efforts[0].get(name)} and {efforts[1].get(name)}."
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
    """The rows of both runs side by side, with NaN where one has none."""
    both = a[["task", *NAMES, "status", "cost_gap"]].merge(b[["task", *NAMES, "status", "cost_gap"]], on=["task", *NAMES],
                                                           how="outer", suffixes=("_a", "_b"), indicator="in_run")
    both = both.rename(columns={"cost_gap_a": "gap_a", "cost_gap_b": "gap_b"})
    return both.assign(in_run=both.in_run.astype(str), status_a=both.status_a.fillna(""), status_b=both.status_b.fillna(""))


def _times(a: Run, b: Run) -> tuple[pd.DataFrame, dict[str, float]]:
    """Ratios with intervals and corrected p-values by task, and the noise bands."""
    parts: list[pd.DataFrame] = []
    noise: dict[str, float] = {}
    done: set[str] = set()
    for what in TIMES:
        try:
            effects = effects_of(a, b, what)
        except RunError:  # neither run need have times of every kind
            continue
        effects = effects[~effects.task.isin(done)]
        if effects.empty:
            continue
        done |= set(effects.task)
        found = compare(effects)
        noise[what] = found.noise
        parts.append(_intervals(found).assign(timed=what))
    columns = ["task", "ratio", "own_ratio", "ratio_low", "ratio_high", "p", "timed"]
    table = pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)
    return table.assign(adjusted=benjamini_hochberg(table.p.to_numpy(dtype=float))), noise


def _intervals(found: Comparison) -> pd.DataFrame:
    half = student.ppf(0.975, found.table.freedom) * np.hypot(found.table.deviation, found.noise)
    return found.table.assign(ratio_low=np.exp(found.table.log_ratio - half), ratio_high=np.exp(found.table.log_ratio + half))


def _changes(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Everything that changed in a row, of KINDS."""
    if row["in_run"] != "both":
        return ("gone",) if row["in_run"] == "left_only" else ("new",)
    found = []
    if row["adjusted"] < LEVEL and row["own_ratio"] != 1.0:
        found.append("slower" if row["own_ratio"] > 1.0 else "faster")
    gaps = (row["gap_a"], row["gap_b"])
    if max(gaps) > LEAST_GAP and max(gaps) > GAP_FACTOR * min(gaps):
        found.append("less accurate" if gaps[1] > gaps[0] else "more accurate")
    if row["status_a"] != row["status_b"]:
        found.append("status changed")
    return tuple(found)


def _broke(row: Mapping[str, Any]) -> bool:
    """Whether a row was right and is so no more."""
    return bool(row["status_a"] == Status.OK and row["status_b"] != Status.OK)
