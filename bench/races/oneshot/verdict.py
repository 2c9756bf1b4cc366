"""A one-shot race in words: who wins at which accuracy, where the paper's method stands, whether the stage would notice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from bench.races.calibration import IN_LANE_DIRECT
from bench.races.metrics import TOLERANCE, UNNOTICED
from bench.races.oneshot import figures
from bench.races.oneshot.ranking import ASKED, PACE, Line, of_paper, ranking, scaling_of
from bench.report.words import apart, joined, marked, number, percent, periods, settings_label, solver_lanes
from bench.timing.schedule import PERIOD_US
from piezo_model.json_file import decoded
from solvers import Lane, Tier
from solvers.registry import OURS

GAPS = (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT)


def verdict(rows: pd.DataFrame) -> list[str]:
    """At most three sentences."""
    lines = ranking(rows)
    return [*_winners([line for line in lines if line.name != PACE]), *_paper(rows, [line for line in lines if line.name == PACE]), *_stage(rows)]


def _winners(lines: Sequence[Line]) -> Iterator[str]:
    targets = [tier for tier in GAPS if any(tier in line.results for line in lines)] or [Tier.DEFAULT]
    tightest = targets[min(len(targets) - 1, 2)]
    asked = [line.results[tightest] for line in lines if tightest in line.results]
    most = max((result.problems for result in asked), default=0)
    found = (f"{solver_lanes(sum(result.reached for result in asked), len(asked), 'reach')} {ASKED.get(tightest, '1e-3 by default')} "
             f"on {'the problem' if most == 1 else f'all {most} problems'}")
    fastest, others = _fastest(lines, targets), _fastest([line for line in lines if line.solver not in OURS], targets)
    theirs = f", and among the solvers by others {others.removeprefix('at every accuracy: ')}" if others not in ("", fastest) else ""
    yield found + (f"; fastest {fastest}" if fastest else "") + theirs + "."


def _fastest(lines: Sequence[Line], targets: Sequence[Tier]) -> str:
    """The winners of the targets, each with all that it wins."""
    won: dict[str, dict[Tier, float]] = {}
    for tier in targets:
        right = [line for line in lines if tier in line.results and line.results[tier].reached]
        if right:
            best = min(right, key=lambda line: line.results[tier].us)
            won.setdefault(f"{best.name} ({best.lane})", {})[tier] = best.results[tier].us
    if len(won) == 1 and len(next(iter(won.values()))) == len(targets):
        ((name, us),) = won.items()
        return f"{'at every accuracy: ' if len(targets) > 1 else ''}{name} with {_times([*us.values()])}"
    return joined(f"to {joined(ASKED.get(tier, '1e-3') for tier in us)}: {name} with {_times([*us.values()])}"
                  for name, us in won.items()) if won else ""


def _times(us: Sequence[float]) -> str:
    low, high = number(min(us)), number(max(us))
    return f"{low} µs ({periods(min(us) / PERIOD_US)})" if low == high else f"{low} to {high} µs"


def _steps(rows: pd.DataFrame) -> pd.DataFrame:
    """The paper's learning phase of 15 200 steps, one row a problem."""
    part = of_paper(rows)
    return part[(part.start == "cold") & part.settings.str.contains('"steps": 15200')].drop_duplicates("task")


def _paper(rows: pd.DataFrame, lines: Sequence[Line]) -> Iterator[str]:
    part = _steps(rows[rows.scaling == scaling_of(rows)])
    if part.empty:
        return
    reach = [f"{ASKED[tier]} on {line.results[tier].right}" for line in lines for tier in GAPS[:3] if tier in line.results]
    yield (f"The paper's method, one projected step a sample, {_ends(part)} after its 15 200 steps (1.9 s)"
           + (f" and reaches {joined(reach)} of {len(part)} problems" if reach else "")
           + f"; without waiting for samples these steps take {number((part.update_us + part.solve_us_p50).median())} µs.")


def _ends(part: pd.DataFrame) -> str:
    """Where the steps end."""
    gaps = part.cost_gap
    if len(gaps) == 1 or gaps.median() == gaps.max():
        return f"ends {percent(gaps.max())} above the optimal cost"
    return f"ends at worst {percent(gaps.max())} above the optimal cost (median {percent(gaps.median())})"


def _stage(rows: pd.DataFrame) -> Iterator[str]:
    """Whether the paper's model is told from the optimum's by the rule of the tier stage."""
    part = _steps(rows[rows.scaling == scaling_of(rows)])
    part = part[part.stage_excess.notna()]
    if part.empty:
        return
    noticed, most = int((part.stage_excess > UNNOTICED).sum()), part.sort_values("stage_excess").iloc[-1]
    steps, best = apart(most.model_error_um, most.optimum_error_um)
    says = f"would notice on {noticed}" if noticed else "would not notice on any"
    more = f", {number(most.stage_excess)} times the sensor's noise more" if most.stage_excess > 0.0 else ""
    yield (f"The stage {says} of {len(part)} problems that the optimum was not reached: on {most.problem} the paper's model errs by {steps} µm "
           f"RMS on unseen data and the optimum's by {best} µm{more} (up to {UNNOTICED:g} times goes unnoticed).")


def notes(rows: pd.DataFrame, summary: pd.DataFrame) -> list[str]:
    """What else a race shows: other scalings, warm starts, cold caches, settings that differ by lane."""
    table = figures.raced(summary)
    return [*_other_scalings(rows), *_warm(summary), *_turns(table), *_lanes(rows)]


def below_rounding(costs: pd.DataFrame) -> Iterator[str]:
    """Problems of which 1e-9 of the yardstick is less than rounding leaves of the cost, a sum of about d products as large as V*."""
    resolved = costs.d * np.finfo(float).eps * costs.V.abs()
    for name, part in costs[TOLERANCE[Tier.HIGH] * costs.yardstick < resolved].groupby("problem", sort=False):
        yield (f"On {name} a cost gap of 1e-9 is {TOLERANCE[Tier.HIGH] / part.optimum.max():.1e} of |V*|, less than rounding leaves of a cost in "
               "double precision: a solver that stops by the difference of two costs cannot tell whether it is there.")


def _other_scalings(rows: pd.DataFrame) -> Iterator[str]:
    for scaling, part in _steps(rows[rows.scaling != scaling_of(rows)]).groupby("scaling"):
        yield f"On {scaling} data the paper's method {_ends(part)} after its 15 200 steps."


def _warm(table: pd.DataFrame) -> Iterator[str]:
    """What a start at the optimum of the problem before is worth."""
    same = [name for name in figures.GROUP if name != "start"]
    both = figures.raced(table, "warm").merge(figures.raced(table), on=same, suffixes=("", "_cold"))
    for scaling, part in both[both.all_right & both.all_right_cold].groupby("scaling", sort=False):
        best = part.sort_values("total_us").iloc[0]
        ratio = part.solve_us_p50 / part.solve_us_p50_cold
        yield (f"Started from the optimum of the problem before, on {scaling} data, {marked(best.solver)} ({best.lane}) is the fastest "
               f"that is right everywhere, with {best.total_us:.3g} µs; a warm solve takes {ratio.median():.2g} times as long as a cold one "
               f"(median over {solver_lanes(len(part))}).")


def _turns(table: pd.DataFrame) -> Iterator[str]:
    """What cold caches cost."""
    ratio = (table.interleaved_us_p50 / table.solve_us_p50).dropna()
    if len(ratio):
        yield (f"With cold caches, after other solvers had their turn, a solve takes {ratio.median():.2g} times as long as hot (median "
               f"over {len(ratio)} solver lanes and tiers, {ratio.min():.2g} to {ratio.max():.2g}).")


def _lanes(rows: pd.DataFrame) -> Iterator[str]:
    """Lanes in which a library is asked otherwise than by its own object, at the tier that all lanes race."""
    first = rows[(rows.tier == Tier.MID) & (rows.scaling == scaling_of(rows)) & (rows.start == "cold")].drop_duplicates(["solver", "lane"])
    asked = {(line.solver, line.lane): decoded(line.settings, dict[str, Any]) for _, line in first.iterrows()}
    for (solver, lane), there in asked.items():
        own = asked.get((IN_LANE_DIRECT.get(solver, solver), Lane.DIRECT))
        if own is not None and lane in (Lane.QPSOLVERS, Lane.CVXPY):
            differ = {name for name in {*there, *own} - {"raise_error"} if there.get(name) != own.get(name)}  # how a failure is said
            has = [settings_label({name: value for name, value in of.items() if name in differ}) or "none of these" for of in (there, own)]
            if differ:
                yield f"At 1e-6 the settings of {solver} in the lane {lane} differ from those in the lane direct: {has[0]}; direct: {has[1]}."
