"""The short table of a race: time to each accuracy, over all problem sets together.

A row is a solver lane in the first scaling, from a cold start. For each tier it has the median time of update plus
solve over the problems at the tier's setting. Rows are ordered by the most accurate tier reached among 1e-9, 1e-6 and
1e-3, then by the time for it. The paper's method comes first, at its own pace of one step per sampling period of the
problem, whatever a step costs.

Ratios of times at the same accuracy and on the same problems: our solver of each lane that is right on most problems,
the fastest of several, to each of the others, and a library through a wrapper to the same in the lane direct.

    ratio = median time of ours over the problems of a size that both are right on / median time of the other

at the settings for a cost gap of 1e-9, from a cold start, for each number of unknowns. *Hot* calls follow each other
directly; *interleaved* with the other solvers, each call finds the caches that they left.

A wrapper is compared at the same settings, on problems on which both are right to 1e-3. The excess over 1 is the cost
of conversion and repeated set-up.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pandas as pd

from bench.derived.measurements import HOT, INTERLEAVED, Measurements
from bench.derived.tiers import PROBLEM, TARGETS, distance, right, supported
from bench.messages.columns import TYPICAL, Column, combined
from bench.messages.task import PAPER, Status, Tier
from bench.race_table import status_counts
from bench.report.report import Table
from bench.report.words import MARK, OURS_NOTE, gap, marked, number, rounded, settings_label
from piezo_model.json_file import decoded
from solvers import Lane
from solvers.registry import FAMILIES, OURS

PACE = f"paper's method{MARK}"
COST_GAP = (
    "Cost gap: the cost above the proven optimum V*, over V* + c, the squared error of the best model: 1e-3 is 0.1 % "
    "more squared error than necessary; for a program from a file, over max(½ x*ᵀPx*, |qᵀx*|)."
)
ORDER = (Tier.HIGH, Tier.MID, Tier.LOW)
TIER_NAMES = {Tier.LOW: "1e-3", Tier.MID: "1e-6", Tier.HIGH: "1e-9", Tier.EXACT: "1e-12", Tier.STAGE: "stage"}
"""Name of a tier on the first screen."""


@dataclass(frozen=True)
class Line:
    """A solver lane, under its name in tables."""

    name: str
    solver: str
    lane: str
    results: dict[Tier, Any]
    """By tier what ``tier_settings`` says, with ``us``, the median over the problems, and whether one setting has
    ``reached`` the tier."""
    default_gap: float
    """Largest gap or violation of its defaults, timed answers included; infinite if an answer is missing."""
    partial: int = 0
    """Number of problems that it was raced on if it was not raced on all of them, else 0."""

    @property
    def place(self) -> tuple[float, ...]:
        """Sort key; smaller is better."""
        best = next(
            (i for i, tier in enumerate(ORDER) if tier in self.results and self.results[tier].reached), len(ORDER)
        )
        at = self.results[ORDER[best]].us if best < len(ORDER) else math.inf
        return self.name != PACE, self.partial > 0, best, at


def ranking(measurements: Measurements) -> list[Line]:
    """The lines of the table, sorted."""
    field, rows, settings = (
        table[table.scaling == measurements.scaling]
        for table in (measurements.lanes, measurements.rows_at_tiers, measurements.settings)
    )
    rows = rows[rows.start == "cold"]
    us = with_pace(rows).groupby(["name", "lane", "tier"]).answer_us.agg(TYPICAL)
    defaults = supported(field[field.is_default & (field.start == "cold")])
    gaps = distance(defaults).groupby([defaults.solver, defaults.lane]).max()
    lines = []
    cold = with_pace(supported(field[field.start == "cold"]))
    lanes = (  # by the tightest setting, for which the defaults do not stand
        cold[cold.rung == cold.groupby(["name", "lane"]).rung.transform("max")]
        .drop_duplicates(["name", "solver", "lane", *PROBLEM])
        .groupby(["name", "solver", "lane"], sort=False)
        .size()
        .reset_index(name="problems")
    )
    for name, solver, lane, problems in lanes.itertuples(index=False):
        of_lane = settings[(settings.solver == solver) & (settings.lane == lane)]
        of_lane = of_lane.assign(us=[us.get((name, lane, tier), math.nan) for tier in of_lane.tier])
        results = {Tier(row.tier): row for row in of_lane.assign(reached=of_lane.us.notna()).itertuples()}
        partial = problems if problems < measurements.problems else 0
        lines.append(Line(name, solver, lane, results, float(gaps.get((solver, lane), math.nan)), partial))
    return sorted(lines, key=lambda line: line.place)


def with_pace(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with their ``name`` in tables, and those of the paper's method a second time as PACE, with the time of
    one step per sampling period."""
    pace = of_paper(rows)
    return pd.concat(
        [
            rows.assign(name=rows.solver.map(marked)),
            pace.assign(name=PACE, answer_us=pace.periods * pace.period_us),
        ],
        ignore_index=True,
    )


def of_paper(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of the paper's method on the problems that it supports, in the lane kernel if it was raced there."""
    rows = rows[rows.solver == PAPER]
    lane = Lane.KERNEL if (rows.lane == Lane.KERNEL).any() else Lane.DIRECT
    return rows[(rows.lane == lane) & (rows.status != Status.UNSUPPORTED)]


def short_table(lines: Sequence[Line], own: Collection[str] | None = None) -> Table:
    """The ranking as text, in cells of at most eleven characters; for a terminal, with the lanes of the user's ``own``
    solvers first and without the wrapper lanes."""
    if own is not None:
        lines = sorted(
            [line for line in lines if line.lane not in FAMILIES] or lines,
            key=lambda line: f"{line.name} ({line.lane})" not in own,
        )
    targets = [tier for tier in TARGETS if any(tier in line.results for line in lines)]
    rows = [
        [
            f"{line.name} ({line.partial} problem{'s' if line.partial > 1 else ''})" if line.partial else line.name,
            line.lane,
            *_cells([line.results.get(tier) for tier in targets]),
            gap(line.default_gap),
        ]
        for line in lines
    ]
    headings = [
        "solver",
        "lane",
        *(f"to {TIER_NAMES[tier]}" if tier is not Tier.STAGE else "stage" for tier in targets),
        "default gap",
    ]
    return Table(
        "Time to accuracy",
        headings,
        rows,
        2,
        ("lane",),
        f"{'Your own solvers come first. ' * bool(own)}{COST_GAP} Times: µs of update and solve at the loosest setting "
        "that is right on every problem. ✗2/3: there is none; the best is right on 2 of 3. Lanes that were raced on "
        f"fewer problems come last, with their number. =: the same setting as in the column before. {OURS_NOTE}",
        tips={
            (i, 2 + targets.index(tier)): f"errs most on {result.worst}"
            for i, line in enumerate(lines)
            for tier, result in line.results.items()
            if not result.reached
        },
    )


def _cells(results: Sequence[Any]) -> list[str]:
    """The cells of a line; "=" stands for the same setting as in the cell before."""
    return [
        "–"
        if result is None
        else f"✗{result.right}/{result.problems}"
        if not result.reached
        else "="
        if before is not None and before.setting == result.setting
        else number(result.us)
        if result.us < 1e6
        else f"{result.us:.1e}".replace("e+0", "e")
        for before, result in pairwise([None, *results])
    ]


BESIDE = (
    Column("lane", heading="lane"),
    Column("timed", heading="timed"),
    Column("d", heading="unknowns"),
    Column("problems", None, "sum", "problems", of="shared"),
    Column("sets", None, status_counts, "of"),
    Column("ours", heading="ours", format=marked),
    Column("ours_us", None, TYPICAL, "µs", number),
    Column("other", heading="other"),
    Column("version", heading="version"),
    Column("other_us", None, TYPICAL, "other, µs", number),
    Column(
        "ratio", heading="ours / other", format=lambda ratio: f"{ratio:.2f}" if ratio >= 0.1 else rounded(ratio, 1.0)
    ),
)


def like_with_like(measurements: Measurements) -> pd.DataFrame:
    """BESIDE without the versions, one row per lane, way of timing, number of unknowns d and other solver that reaches
    1e-9, the fastest first.

    Times are those of the problems that both reach it on, whose number is ``problems``; NaN if there are none.
    """
    rows = measurements.first_screen(measurements.rows_at_tiers[measurements.rows_at_tiers.tier == Tier.HIGH])
    times = {HOT: rows.answer_us, INTERLEAVED: rows.interleaved_us}
    rows = pd.concat([rows.assign(timed=timed, us=us) for timed, us in times.items()]).dropna(subset="us")
    ours = rows[rows.solver.isin(OURS)].rename(columns={"solver": "ours"})
    lanes = ours.groupby(["lane", "timed", "ours"]).us.agg(["size", TYPICAL]).reset_index()
    best = lanes.sort_values(["size", TYPICAL], ascending=[False, True]).drop_duplicates(["lane", "timed"])
    others = rows[~rows.solver.isin(OURS)].rename(columns={"solver": "other"})
    pairs = ours.merge(best, on=["lane", "timed", "ours"]).merge(others, on=["lane", "timed", "d"], suffixes=("", "_2"))
    shared = (pairs.problem_set == pairs.problem_set_2) & (pairs.problem == pairs.problem_2)
    pairs = pairs.assign(
        shared=shared,
        sets=pairs.problem_set.where(shared),
        ours_us=pairs.us.where(shared),
        other_us=pairs.us_2.where(shared),
    )
    table = combined(pairs, BESIDE, ["lane", "timed", "d", "ours", "other"])
    return table.assign(ratio=table.ours_us / table.other_us).sort_values(["timed", "lane", "d", "other_us"])


OTHER_NAMES = {"highs": "highspy", "proxqp": "proxsuite"}
"""Names in the lane direct of libraries that qpsolvers and cvxpy call differently."""
REPORTING = {"raise_error"}
"""Settings that affect how a failure is reported, but not the answer."""
WRAPPERS = (
    Column("solver", heading="solver"),
    Column("lane", heading="lane"),
    Column("settings", None, "first", "settings", settings_label),
    Column("problems", None, "size", "problems", of="ratio"),
    Column("us", None, TYPICAL, "µs", number),
    Column("library", None, "first", "direct"),
    Column("direct_us", None, TYPICAL, "direct, µs", number),
    Column("ratio", None, TYPICAL, "solver / direct", number),
)


def wrapper_share(measurements: Measurements) -> pd.DataFrame:
    """WRAPPERS, one row per wrapper and setting that the lane direct has, too; medians over the ``problems`` on which
    both are right."""
    rows = measurements.first_screen(measurements.lanes)
    rows = rows.assign(us=rows.answer_us, key=rows.settings.map(_key), library=rows.solver.replace(OTHER_NAMES))
    rows = rows[right(rows, Tier.LOW) & (rows.key != "")]
    direct = (
        rows[rows.lane == Lane.DIRECT].drop(columns="library").rename(columns={"solver": "library", "us": "direct_us"})
    )
    same = ["problem_set", "problem", "library", "key"]
    both = rows[rows.lane.isin([str(lane) for lane in FAMILIES])].merge(
        direct[[*same, "direct_us"]].drop_duplicates(same), on=same
    )
    return combined(both.assign(ratio=both.us / both.direct_us), WRAPPERS, ["solver", "lane", "setting"])


def _key(settings: str) -> str:
    """The settings that affect the answer, as a text; "" for defaults, which differ between packages."""
    effective = {name: value for name, value in decoded(settings, dict[str, Any]).items() if name not in REPORTING}
    return repr(sorted(effective.items())) if effective else ""
