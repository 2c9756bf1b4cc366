"""Every figure of a report, computed here once and rendered elsewhere.

A *summary* row stands for one solver in one lane, at one tier with the rung that serves it, in one scaling, cold or warm, over all
problems of the run: how many reach the tier, the worst cost gap, and medians over the problems of the medians of the times. One that
does not reach it on all problems has missed the tier, and ranks below those that do. The last row of each scaling is the floor, a
solver that does nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from bench.races import null_solver
from bench.races.metrics import UNNOTICED
from solvers import Status, Tier

GROUP = ["problem_set", "scaling", "solver", "lane", "tier", "rung", "start"]
FLOOR = "floor"
"""Name and status of the solver that does nothing: its own name, null, would be read from a CSV as a missing value."""


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row a solver, lane, tier, rung, start and scaling: right answers first, then by time, the floor last.

    ``settings`` are those of the first problem; tolerances are multiples of a constant of each.
    """
    rows = rows.assign(right=rows.status == Status.OK, total_us=rows.update_us + rows.solve_us_p50)
    table = rows.groupby(GROUP, dropna=False).agg(
        settings=("settings", "first"), problems=("right", "size"), right=("right", "sum"), status=("status", _statuses),
        worst_cost_gap=("cost_gap", _worst), median_cost_gap=("cost_gap", "median"),
        worst_primal_residual=("primal_residual", _worst), worst_dual_residual=("dual_residual", _worst),
        worst_weight_error=("weight_error", _worst), model_error_percent=("model_error_percent", "median"),
        model_error_um=("model_error_um", "median"), setup_us=("setup_us", "median"), update_us=("update_us", "median"),
        solve_us_p50=("solve_us_p50", "median"), solve_us_p99=("solve_us_p99", _known),
        solve_us_max=("solve_us_max", "max"), solve_us_spread=("solve_us_spread", "median"),
        interleaved_us_p50=("interleaved_us_p50", _known), interleaved_us_p99=("interleaved_us_p99", _known),
        total_us=("total_us", "median"), periods=("periods", "median"),
        repeatable=("repeatable", "all"), mutates_input=("mutates_input", "any"), message=("message", _first_message),
    ).reset_index()
    table["all_right"] = table.right == table.problems
    floor = table.solver == null_solver.ENTRY.name
    table.loc[floor, ["solver", "status"]] = FLOOR
    order = ["problem_set", "scaling", "floor", "all_right", "total_us"]
    return table.assign(floor=floor).sort_values(order, ascending=[True, False, True, False, True],
                                                 ignore_index=True).drop(columns="floor")


def raced(table: pd.DataFrame, start: str = "cold") -> pd.DataFrame:
    """Of a summary, the rows of solvers that start cold, or warm; not the floor, nor rungs for the picture."""
    return at_tiers(table[(table.status != FLOOR) & (table.start == start)])


def at_tiers(table: pd.DataFrame) -> pd.DataFrame:
    """Without the rungs that serve the picture alone."""
    return table[table.tier != Tier.RUNG]


def _worst(values: pd.Series) -> float:
    """The largest; NaN where any problem has no answer, so that failing most of them does not look like exactness."""
    return float(values.max(skipna=False))


def _known(values: pd.Series) -> float:
    """The median; NaN where any problem has no such figure, so that the quick ones do not stand for all."""
    return float(values.median(skipna=False))


def _statuses(values: pd.Series) -> str:
    counts = values.value_counts()
    return str(counts.index[0]) if len(counts) == 1 else ", ".join(f"{count} {name}" for name, count in counts.items())


def _first_message(values: pd.Series) -> str:
    said = [value for value in values if value]
    return str(said[0]) if said else ""


@dataclass(frozen=True)
class Verdict:
    """The run in words."""

    sentences: tuple[str, ...]


def verdict(rows: pd.DataFrame) -> Verdict:
    """Say who was right and how fast, what the paper's steps reach, and whether the stage would notice."""
    whole = summary(rows)
    table = raced(whole)
    stepping = table.settings.str.contains('"steps"')
    sentences = []
    for scaling, part in table[~stepping].sort_values("scaling", ascending=False, kind="stable").groupby("scaling", sort=False):
        tier = "high" if (part.tier == "high").any() else part.tier.iloc[0]
        asked = part[part.tier == tier].groupby(["solver", "lane"]).agg(  # over all problem sets
            all_right=("all_right", "all"), total_us=("total_us", "median"), periods=("periods", "median")).reset_index()
        right = asked[asked.all_right].sort_values("total_us")
        sentence = f"On {scaling} data {len(right)} of {len(asked)} solver lanes reach the tier {tier} on every problem"
        if len(right):
            best = right.iloc[0]
            sentence += (f"; the fastest of them is {best.solver} ({best.lane}), whose update and solve take {best.total_us:.3g} µs, "
                         f"{_periods(best.periods)}")
        sentences.append(sentence + ".")
    sentences += [*_paper_sentences(rows[rows.start == "cold"]), *_warm_sentences(whole), *_turn_sentences(table)]
    return Verdict(tuple(sentences))


def failures(rows: pd.DataFrame) -> list[list[str]]:
    """What went wrong, once a solver lane, tier, scaling and status: these, how often, the first problem and its message.

    Breakdowns come first, then answers that are not exact enough. That the upper rungs for the picture fail is in their nature.
    """
    wrong = at_tiers(rows[(rows.message != "") & (rows.solver != null_solver.ENTRY.name)])
    wrong = wrong.assign(late=wrong.status.isin([str(Status.MISSED), str(Status.UNSUPPORTED)]))
    lines = [[*names[1:], str(len(part)), f"{part.problem_set.iloc[0]}/{part.problem.iloc[0]}", part.message.iloc[0]]
             for names, part in wrong.groupby(["late", "solver", "lane", "tier", "scaling", "status"], sort=True)]
    return [[str(cell) for cell in line] for line in lines]


def _periods(count: float) -> str:
    return f"{count:.2g} of a sampling period" if count < 1.0 else f"{count:.3g} sampling periods"


def _warm_sentences(table: pd.DataFrame) -> list[str]:
    """What a start at the optimum of the problem before is worth."""
    same = [name for name in GROUP if name != "start"]
    both = raced(table, "warm").merge(raced(table), on=same, suffixes=("", "_cold"))
    sentences = []
    for scaling, part in both[both.all_right & both.all_right_cold].groupby("scaling", sort=False):
        best = part.sort_values("total_us").iloc[0]
        ratio = part.solve_us_p50 / part.solve_us_p50_cold
        sentences.append(f"Started from the optimum of the problem before, with {scaling} data, the fastest that is always "
                         f"right is {best.solver} ({best.lane}) with {best.total_us:.3g} µs; a warm solve takes "
                         f"{ratio.median():.2g} of a cold one in the median of {len(part)} solver lanes.")
    return sentences


def _turn_sentences(table: pd.DataFrame) -> list[str]:
    """What cold caches cost."""
    ratio = (table.interleaved_us_p50 / table.solve_us_p50).dropna()
    if ratio.empty:
        return []
    return [f"In turns with the other solvers a solve takes {ratio.median():.2g} times as long as hot (median of "
            f"{len(ratio)} solver lanes and tiers, from {ratio.min():.2g} to {ratio.max():.2g})."]


def _paper_sentences(rows: pd.DataFrame) -> list[str]:
    """What the paper's method reaches in its learning phase, and whether the stage would notice."""
    steps = rows[(rows.solver == "projected_difference") & (rows.lane == "kernel")
                 & rows.settings.str.contains('"steps": 15200')].drop_duplicates("task")
    sentences = []
    for scaling, part in steps.sort_values("scaling", ascending=False, kind="stable").groupby("scaling", sort=False):
        least, most = part.cost_gap.min(), part.cost_gap.max()
        span = f"{_percent(least)} to {_percent(most)}" if 0.01 * most < least < most else f"at most {_percent(most)}"
        sentence = (f"The paper's 15 200 projected steps, 1.9 s of machine time, end on {scaling} data {span} above the optimal "
                    f"cost (median {_percent(part.cost_gap.median())})")
        both = part[part.optimum_error_um.notna() & part.model_error_um.notna()]
        if not both.empty:
            noticed = int((both.stage_excess > UNNOTICED).sum())
            sentence += (f"; on data that the fit has not seen their model errs by {both.model_error_um.median():.3g} µm RMS and "
                         f"that of the exact optimum by {both.optimum_error_um.median():.3g} µm, which the stage would notice on "
                         f"{noticed} of {len(both)} problems, where it is more than 1 % of its sensor's noise")
        sentences.append(sentence + ".")
    return sentences


def _percent(share: float) -> str:
    """A cost gap for a reader.

    Examples
    --------
    >>> [_percent(share) for share in (0.0, 0.0062, 3.14, 641.2)]
    ['less than 1e-9 %', '0.62 %', '314 %', '641 times']
    """
    if share < 1e-11:
        return "less than 1e-9 %"
    if share >= 10.0:
        return f"{share:.0f} times"
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:.0f} %"
