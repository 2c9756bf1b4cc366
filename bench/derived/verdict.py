"""The result of a race in sentences: the fastest solver of each lane, the paper's method, the effect on the
stage.

Solvers are compared within a lane, ours with the best of the others, and the machine's instruction set, compiler and
drift are stated. Times have as many digits as the drift allows; a reservation precedes the numbers that it concerns.
"""

from collections.abc import Iterator, Sequence

import pandas as pd

from bench.derived import summary as summaries
from bench.derived.measurements import Measurements
from bench.derived.ranking import PACE, TIER_NAMES, Line, of_paper, ranking
from bench.derived.tiers import FEWEST, UNNOTICED, right
from bench.messages.task import PAPERS_SETTING, Tier
from bench.report.words import format_distinct, joined, marked, number, percent, rounded, solver_lanes
from solvers import Lane
from solvers.registry import OURS

GAPS = (Tier.HIGH, Tier.MID, Tier.LOW, Tier.EXACT)
"""The first of these tiers that any solver lane reaches is the one of the verdict."""
LANE_NAMES = {Lane.KERNEL: "compiled", Lane.DIRECT: "from Python"}
"""Lanes of the verdict and their names in it."""
MOST_DRIFT = 0.1
"""Largest drift without a caution."""


def verdict(measurements: Measurements, core: str = "", drift: float = 0.0) -> list[str]:
    """At most five sentences; ``core`` is instruction set and compiler, ``drift`` the relative drift of the machine."""
    lines = ranking(measurements)
    sentences = [
        *_winners(measurements, [line for line in lines if line.name != PACE], core, drift),
        *_paper(measurements, drift),
    ]
    if drift > MOST_DRIFT and any("µs" in sentence for sentence in sentences):
        sentences.insert(
            0,
            f"Caution: in one fifth of the race the speed of the machine differed by {100.0 * drift:.0f} % from that "
            "of the whole race, so smaller differences between times are not significant.",
        )
    return [*sentences, *_stage(measurements)]


def _winners(measurements: Measurements, lines: Sequence[Line], core: str, drift: float) -> Iterator[str]:
    partial, lines = [line for line in lines if line.partial], [line for line in lines if not line.partial]
    at = next(
        (tier for tier in GAPS if any(tier in line.results and line.results[tier].reached for line in lines)), None
    )
    problems = "the problem" if measurements.problems == 1 else f"all {measurements.problems} problems"
    if partial and not lines:
        yield f"None of {solver_lanes(len(partial))} was raced on {problems}; the table says on how many each was."
        return
    if at is None:
        yield (
            f"No solver reaches {TIER_NAMES[Tier.LOW] if any(line.results for line in lines) else 'any accuracy'} on "
            f"{problems} with one setting."
        )
        return
    judged = [line for line in lines if at in line.results]
    reach = [line for line in judged if line.results[at].reached]
    chosen = "" if measurements.problems >= FEWEST else ", each with a setting chosen on the problem it is judged on"
    lanes = [lane for lane in LANE_NAMES if any(line.lane == lane for line in reach)]
    fastest = joined(_lane(lane, [line for line in reach if line.lane == lane], at, drift) for lane in lanes)
    more = f"; fastest {fastest}" if fastest else ""
    fewer = f"; {solver_lanes(len(partial))} raced on fewer problems and not counted" if partial else ""
    hosts = measurements.all_rows.host.nunique()
    there = f"times of {measurements.host}, one of {hosts} machines; " if hosts > 1 else ""
    machine = f" ({there}{core}; drift {100.0 * drift:.0f} %)" if core else ""
    reached = f"{solver_lanes(len(reach), len(judged), 'reach')} {TIER_NAMES[at]} on {problems}"
    yield f"{reached}{chosen}{more}{fewer}{machine}."


def _lane(lane: Lane, lines: Sequence[Line], at: Tier, drift: float) -> str:
    """The fastest solver of a lane, and the best of the others if it is ours, or our best if it is not."""
    ranked = sorted(lines, key=lambda line: line.results[at].us)
    best = ranked[0]
    other = next((line for line in ranked if (line.solver in OURS) != (best.solver in OURS)), None)
    beside = "" if other is None else f" beside {other.name} {rounded(other.results[at].us, drift)} µs"
    return f"{LANE_NAMES[lane]} {best.name} {rounded(best.results[at].us, drift)} µs{beside}"


def _steps(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of the paper's learning phase of 15 200 steps of half the stability limit, one per problem."""
    rows = of_paper(rows)
    return rows[(rows.start == "cold") & (rows.settings == PAPERS_SETTING)].drop_duplicates("task")


def _paper(measurements: Measurements, drift: float) -> Iterator[str]:
    lanes = measurements.lanes[measurements.lanes.scaling == measurements.scaling]
    steps = _steps(lanes).dropna(subset="cost_gap")
    if steps.empty:
        return
    seconds = [f"{duration_us * 1e-6:.3g}" for duration_us in sorted({*(steps.periods * steps.period_us)})]
    to = f" to {seconds[-1]} s, by the rate of the recording" if seconds[1:] else " s"
    reach = joined(f"{TIER_NAMES[tier]} on {right(steps, tier).sum()}" for tier in (Tier.LOW, Tier.MID, Tier.HIGH))
    yield (
        f"The paper's method, one projected step a sample of half the stability limit, {_ends(steps)} after its 15 200 "
        f"steps ({seconds[0]}{to}) and reaches {reach} of {len(steps)} problems; without waiting "
        f"for samples these steps take {rounded(steps.answer_us.median(), drift)} µs."
    )


def _ends(rows: pd.DataFrame) -> str:
    """The cost gap at the end of the steps."""
    gaps = rows.cost_gap
    if gaps.median() == gaps.max():
        return f"ends {percent(gaps.max())} above the optimal cost"
    return f"ends at worst {percent(gaps.max())} above the optimal cost (median {percent(gaps.median())})"


def _stage(measurements: Measurements) -> Iterator[str]:
    """On how many problems the tier `stage` finds the paper's model worse or better than the optimal one."""
    judged = _steps(measurements.lanes[measurements.lanes.scaling == measurements.scaling])
    judged = judged[judged.stage_excess.notna()]
    if judged.empty:
        return
    worse, better = (int((sign * judged.stage_excess > UNNOTICED).sum()) for sign in (1.0, -1.0))
    largest = judged.iloc[int(judged.stage_excess.abs().argmax())]
    steps, best = format_distinct(largest.model_error_um, largest.optimum_error_um)
    yield (
        f"The prediction error of the paper's model on unseen data is larger than that of the optimum on {worse} of "
        f"{len(judged)} problems, smaller on {better} and the same on {len(judged) - worse - better}, where "
        f"{percent(UNNOTICED)} of the sensor's noise counts as a difference; it differs most on {largest.problem}: "
        f"{steps} against {best} µm RMS, with a noise of {number(largest.noise_um)} µm."
    )


def warm_starts(table: pd.DataFrame) -> Iterator[str]:
    """Benefit of starting at the optimum of the problem before."""
    table = table[table.status != summaries.NOTHING].drop_duplicates([n for n in summaries.GROUP if n != "tier"])
    same = [name for name in summaries.GROUP if name not in ("start", "tier")]
    both = table[table.start == "warm"].merge(table[table.start == "cold"], on=same, suffixes=("", "_cold"))
    for scaling, lanes in both[both.all_right & both.all_right_cold].groupby("scaling", sort=False):
        best = lanes.sort_values("answer_us").iloc[0]
        ratio = lanes.solve_us_p50 / lanes.solve_us_p50_cold
        yield (
            f"Started from the optimum of the problem before, on {scaling} data, {marked(best.solver)} "
            f"({best.lane}) is the fastest "
            f"that is right everywhere, with {best.answer_us:.3g} µs; a warm solve takes {ratio.median():.2g} times "
            f"as long as a cold one (median over {solver_lanes(len(lanes))})."
        )


def cold_caches(measurements: Measurements) -> Iterator[str]:
    """Cost of cold caches."""
    rows = measurements.first_screen(measurements.lanes)
    ratio = (rows.interleaved_us / rows.answer_us).groupby([rows.solver, rows.lane]).median().dropna()
    if len(ratio):
        yield (
            f"Interleaved with other solvers, which leave cold caches, an answer takes {ratio.median():.2g} times as "
            f"long as hot (median over {solver_lanes(len(ratio))}, {ratio.min():.2g} to {ratio.max():.2g})."
        )
