"""Which tiers a solver lane reaches in one of two runs only, and which have another setting.

Each run has one setting of a solver lane for a tier (`bench.derived.tier_settings`), found here on the problems that both have. Two
things may take a tier away without a change of the solver: timed answers, since each run draws their data anew, and a call near the
0.1 s that end a ladder. A tier that is lost or gained with them, and is not without them, is so by chance,

    unless the timed answers are worse (or better) in more problems than chance explains.

A problem in one scaling, cold or warm, counts once, since all settings have the same fresh data there: its vote is the sign of the number of
verdicts, over settings and tiers, that turned right less those that turned wrong by the timed answers alone. Of n votes of a solver lane,
K ~ Binomial(n, 1/2) are for worse: the exact test of Q. McNemar (Psychometrika 12 (1947) 153 to 157), corrected over the solver lanes.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from scipy.stats import binomtest, false_discovery_control

from bench.comparison.levels import NAMES
from bench.comparison.lines import LEVEL, MOST_NAMED
from bench.derived.accuracy import MEASURED, right
from bench.derived.ranking import ASKED
from bench.derived.tier_settings import LANE, PROBLEM, TARGETS, tier_settings
from bench.races.oneshot.rows import ENDS
from bench.report.words import joined, marked, solver_lanes
from solvers import Status, Tier

LOST, GAINED, OTHER = "lost", "gained", "another setting"
"""What may change in a tier of a solver lane."""
VERBS = {LOST: "no longer", GAINED: "now"}
WHO = ["solver", "lane"]


def compare_tiers(a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """One row a scaling, solver lane and tier that one of the runs reaches, of the solver lanes and problems of both.

    ``a`` and ``b`` have a row a task. Columns: LANE, ``tier``, ``setting_a``, ``setting_b`` ("" where it is not reached), ``change`` (LOST,
    GAINED, OTHER or "") and ``by_chance``, which is False where the change is none of the draw or the clock.
    """
    a, b = _common(a, b, PROBLEM), _common(b, a, PROBLEM)
    found = _side_by_side(a, b)
    repeatable = _side_by_side(*_repeatable(a, b)).set_index([*LANE, "tier"]).change
    same = found.change == repeatable.reindex(pd.MultiIndex.from_frame(found[[*LANE, "tier"]])).to_numpy()
    systematic = pd.MultiIndex.from_frame(found[WHO]).isin(_changed_on_fresh_data(a, b))
    found["by_chance"] = found.change.isin((LOST, GAINED)) & ~same & ~systematic
    return found[(found.setting_a != "") | (found.setting_b != "")].reset_index(drop=True)


def sentences(tiers: pd.DataFrame) -> list[str]:
    """What was lost and gained otherwise than by chance, one sentence a solver lane and scaling, or one for all where they are many."""
    said = []
    for change, how in VERBS.items():
        those = tiers[(tiers.change == change) & ~tiers.by_chance]
        lanes = those.groupby(LANE, sort=False)
        each = [f"{marked(str(solver))} ({lane}) {how} reaches {joined(ASKED[Tier(tier)] for tier in part.tier)} on {scaling} data"
                for (scaling, solver, lane), part in lanes]
        said += [f"{sentence}." for sentence in each] if len(each) <= MOST_NAMED else [
            f"{solver_lanes(those.groupby(WHO).ngroups)} {how} reach {len(those)} tiers, among them: {'; '.join(each[:3])}."]
    return said


def notes(tiers: pd.DataFrame) -> list[str]:
    """What changed by chance, and where another setting has taken over."""
    drawn, other = int(tiers.by_chance.sum()), int((tiers.change == OTHER).sum())
    found = [f"Tiers that are reached in one of the runs only, by chance as far as can be told: {drawn}. Each run draws the data of its timed "
             "answers anew, and a call near 0.1 s ends a ladder in one run and not in another."] if drawn else []
    return found + ([f"In {other} of {len(tiers)} tiers of solver lanes another setting is the loosest that does; times are compared at equal "
                     "settings."] if other else [])


def _side_by_side(a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """The settings of both runs, with what changed."""
    columns = [*LANE, "tier", "setting"]
    both = tier_settings(a)[columns].merge(tier_settings(b)[columns], on=columns[:-1], suffixes=("_a", "_b"))
    change = np.select([both.setting_a == both.setting_b, both.setting_b == "", both.setting_a == ""], ["", LOST, GAINED], OTHER)
    return both.assign(change=change)


def _repeatable(a: pd.DataFrame, b: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Both without timed answers, and without the rows that the clock kept one of them from running."""
    kept = []
    for rows in (a, b):
        ended = rows.status.isin([str(status) for status in ENDS]).groupby([rows[name] for name in MEASURED]).transform("any")
        kept.append(rows.assign(timed_gap=math.nan)[(rows.status != Status.NOT_RUN) | ended])
    slow = pd.concat([rows.loc[rows.index.difference(part.index), NAMES] for rows, part in zip((a, b), kept, strict=True)])
    first, second = (part[~_names(part, NAMES).isin(_names(slow, NAMES))] for part in kept)
    return first, second


def _changed_on_fresh_data(a: pd.DataFrame, b: pd.DataFrame) -> list[tuple[str, str]]:
    """Solver lanes whose timed answers became wrong, or right, in more problems than chance explains."""
    first, second = (rows.set_index(NAMES).sort_index().reset_index() for rows in (_common(a, b, NAMES), _common(b, a, NAMES)))
    turned = pd.Series(0, index=first.index)
    for tier in TARGETS:
        by_first_answer = [right(rows.assign(timed_gap=math.nan), tier) for rows in (first, second)]
        turned += (right(second, tier).astype(int) - right(first, tier).astype(int)).where(by_first_answer[0] & by_first_answer[1], 0)
    votes = np.sign(turned.groupby([first[name] for name in (*MEASURED, "start")]).sum())
    lanes = (votes[votes != 0] < 0).groupby(level=WHO).agg(["sum", "size"])
    if lanes.empty:
        return []
    p = false_discovery_control([binomtest(int(k), int(n)).pvalue for k, n in lanes.itertuples(index=False)])
    return [*lanes.index[p <= LEVEL]]


def _common(rows: pd.DataFrame, other: pd.DataFrame, columns: list[str]) -> pd.DataFrame:
    """The rows that agree in these columns with one of the other run."""
    return rows[_names(rows, columns).isin(_names(other, columns))]


def _names(rows: pd.DataFrame, columns: list[str]) -> pd.MultiIndex:
    return pd.MultiIndex.from_frame(rows[columns])
