"""Numbers and sentences of a stream race; `report` renders them.

A row of the *summary* is one solver in one lane, at one tier, with its settings, over its processes. Late answers come
in bouts, since a delay of the machine makes one sample after the other late; so bouts (runs of late samples) are
compared with those of the null solver, the machine itself: their rates have a ratio with a 95 % interval. A solver is
late if the whole interval is above 1. If the machine itself misses too many deadlines, no solver keeps the schedule. A
percentile of response times is above the floor if its whole interval lies above the floor's.
"""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.messages.task import PAPER
from bench.messages.verdict import Status
from bench.races.stream.race import StreamSettings
from bench.report.words import marked, number, percent, solver_lanes
from bench.timing.percentiles import QUANTILES, Percentile, needed, percentile, rate_ratio
from bench.timing.schedule import PERIOD_NS, PERIOD_US
from solvers import Lane

GROUP = ["solver", "lane", "tier", "settings"]
FLOOR, EXACT = "null", "box_active_set"
TOLD = 4.0
"""Largest ratio of rates that may be left open where a sentence says that two rates do not differ."""
TOLERATED_FLOOR = 0.01
"""Largest share of deadlines missed by the machine itself in a run that can tell who keeps the schedule."""
FAILURES = tuple(
    str(status)
    for status in (Status.ADAPTER_FAILED, Status.UNSUPPORTED, Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY)
)
AGGREGATES = {
    "gap_mean": "mean",
    "gap_max": "max",
    "exact_gap_mean": "mean",
    "exact_gap_max": "max",
    "exact_difference": "max",
    "own_gap_max": "max",
    "reused": "mean",
    "data_us_p50": "median",
    "update_us_p50": "median",
    "solve_us_p50": "median",
}
"""Columns of the rows, and how the processes of a solver are combined."""


def column(kind: str, q: float, end: str = "") -> str:
    """Column of a percentile, such as ``response_p99.9_us`` or ``response_p99.9_low_us``."""
    return f"{kind}_{Percentile(q).name}{f'_{end}' if end else ''}_us"


FARTHEST = QUANTILES[-1]
CORRECTED = column("service_corrected", FARTHEST)
"""Column of a compiled loop's farthest percentile, corrected for the missing schedule."""


def raw(times: pd.DataFrame, tasks: Iterable[str], what: str) -> NDArray[np.float64]:
    """The raw times of some tasks, µs."""
    parts = times[times.task.isin(list(tasks)) & (times.what == what)].ns
    return np.concatenate([np.zeros(0), *parts]) / 1e3


def percentiles(kind: str, microseconds: NDArray[np.float64]) -> dict[str, float]:
    """Percentiles, ends of their intervals, maximum and number of samples by column; NaN for a refused percentile."""
    columns: dict[str, float] = {}
    for q in QUANTILES:
        estimate = percentile(microseconds, q)
        for end, value in (("", estimate.value), ("low", estimate.low), ("high", estimate.high)):
            columns[column(kind, q, end)] = math.nan if value is None else value
    columns[f"{kind}_max_us"] = float(microseconds.max()) if microseconds.size else math.nan
    columns[f"{kind}_samples"] = microseconds.size
    return columns


def corrected(microseconds: NDArray[np.float64], period_us: float = PERIOD_US) -> NDArray[np.float64]:
    """Times of calls back to back, with the response times of the samples that would have waited behind them on a
    schedule: a call of length t > T stands for t, t − T, t − 2 T, … down to the first that is at most T (G. Tene, "How
    NOT to measure latency", 2013).

    Examples
    --------
    >>> corrected(np.array([100.0, 300.0])).tolist()
    [100.0, 300.0, 175.0, 50.0]
    """
    counts = np.maximum(np.ceil(microseconds / period_us), 1).astype(np.int64)
    waited = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.repeat(microseconds, counts) - waited * period_us


def summary(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """One row per solver, lane, tier and settings: the floor, then those that keep up, by median response time."""
    floor = rows[rows.solver == FLOOR]
    machine_bouts = int(floor.stalls.sum()), int(floor.samples.sum())
    table = pd.DataFrame(
        [
            _line(dict(zip(GROUP, names, strict=True)), part, times, machine_bouts)
            for names, part in rows.groupby(GROUP, sort=False)
        ]
    )
    machine = table[table.solver == FLOOR]
    for q in QUANTILES:
        reached = float(machine[column("response", q, "high")].iloc[0]) if len(machine) else math.nan
        table[f"at_floor_{Percentile(q).name}"] = table.paced & (table[column("response", q, "low")] <= reached)
    table["is_floor"] = table.solver == FLOOR
    table["machine_keeps"] = bool((machine.missed <= TOLERATED_FLOOR * machine.samples).all())
    table["keeps_up"] &= table.machine_keeps
    order = ["is_floor", "paced", "keeps_up", column("response", 0.5), column("service", 0.5), "solver", "settings"]
    return table.sort_values(order, ascending=[False, False, False, True, True, True, True], ignore_index=True)


def _line(
    key: Mapping[str, Any], part: pd.DataFrame, times: pd.DataFrame, machine_bouts: tuple[int, int]
) -> dict[str, Any]:
    failed = part[part.status.isin(FAILURES)]
    ran = part.drop(failed.index)
    paced = bool(part.paced.iloc[0])
    samples, stalls = int(ran.samples.sum()), int(ran.stalls.sum())
    service = raw(times, ran.task, "service")
    low, high = rate_ratio(stalls, samples, *machine_bouts) if paced and samples else (0.0, math.inf)
    late = low > 1.0
    status = (
        str(failed.status.iloc[0])
        if len(failed)
        else FLOOR
        if key["solver"] == FLOOR
        else str(Status.MISSED)
        if (ran.status != Status.OK).any()
        else str(Status.LATE if late else Status.OK)
    )
    return {
        **key,
        "setting": part.setting.iloc[0],
        "basis": part.basis.iloc[0],
        "paced": paced,
        "status": status,
        "processes": len(part),
        "samples": samples,
        "solves": int(ran.solves.sum()),
        "stopped": _first(part.stopped),
        "message": _first(part.message),
        "missed": int(ran.missed.sum()),
        "stalls": stalls,
        "bouts_ratio_low": low,
        "bouts_ratio_high": high,
        "keeps_up": bool(len(ran) and not len(failed) and paced and not late),
        "unanswered": int(ran.unanswered.sum()),
        **ran.agg(AGGREGATES),
        **percentiles("service", service),
        CORRECTED: (
            float(np.quantile(corrected(service), FARTHEST, method="inverted_cdf"))
            if not paced and service.size >= needed(FARTHEST)
            else math.nan
        ),
        **percentiles("response", raw(times, ran.task, "response")),
    }


def _first(values: Iterable[str]) -> str:
    return next((str(value) for value in values if value), "")


def verdict(table: pd.DataFrame, settings: StreamSettings) -> list[str]:
    """Sentences on the solvers that keep the schedule, if the machine permits any, and on the cost of stale answers."""
    floor, paced = table[table.is_floor], table[table.paced & ~table.is_floor]
    sentences = []
    if not table.machine_keeps.all():
        sentences.append(
            "This run cannot say who keeps the schedule: the machine itself misses "
            f"{100.0 * floor.missed.iloc[0] / floor.samples.iloc[0]:.2g} % of the deadlines; it was "
            "busy or is too slow."
        )
    elif len(paced):
        kept = paced[paced.keeps_up & (paced.status == Status.OK)]
        sentences.append(
            f"{solver_lanes(len(kept), len(paced), 'keep')} the schedule of {1e6 / PERIOD_NS:g} kHz: they reach their "
            "tier, and their bouts of late answers are not shown to be more frequent than the machine's own"
            + (
                f"; the fastest is {marked(kept.solver.iloc[0])} ({kept.lane.iloc[0]}), with a response time of "
                f"{_tail(kept.iloc[0], 'response')} and {bouts(kept.iloc[0])}."
                if len(kept)
                else "."
            )
        )
    return sentences + _staleness(table, settings)


def bouts(line: pd.Series) -> str:
    """Bouts of late answers, and how often they come beside those of the machine.

    Examples
    --------
    >>> bouts(pd.Series({"stalls": 3, "bouts_ratio_low": 0.4, "bouts_ratio_high": 2.5}))
    '3 bouts of late answers, 0.4 to 2.5 times as often as the machine itself'
    >>> bouts(pd.Series({"stalls": 1, "bouts_ratio_low": 0.03, "bouts_ratio_high": math.inf}))
    '1 bout of late answers, whether more often than the machine itself cannot be told'
    """
    low, high = line.bouts_ratio_low, line.bouts_ratio_high
    count = f"{line.stalls:.0f} bout{'' if line.stalls == 1 else 's'} of late answers"
    if not line.stalls:
        return f"no {count[2:]}"
    if low <= 1.0 and high > TOLD:
        return f"{count}, whether more often than the machine itself cannot be told"
    return f"{count}, {number(low)} to {number(high)} times as often as the machine itself"


def notes(table: pd.DataFrame, settings: StreamSettings) -> list[str]:
    """The machine's own response times, the solvers that were stopped, and the times of our compiled loop."""
    paced, sentences = table[table.paced & ~table.is_floor], []
    for _, line in table[table.is_floor].iterrows():
        sentences.append(
            f"The machine itself, a solver that answers at once on the same schedule, misses {line.missed} of "
            f"{line.samples} deadlines, in {line.stalls} stalls, and responds with {_tail(line, 'response')}, at most "
            f"{number(line.response_max_us)} µs."
        )
    stopped = paced[paced.stopped != ""]
    if len(stopped):
        sentences.append(
            f"{len(stopped)} lanes were late at each of the first {settings.give_up} samples and were "
            f"stopped there; their median service times are {number(stopped['service_p50_us'].min())} to "
            f"{number(stopped['service_p50_us'].max())} µs."
        )
    for _, line in table[~table.paced & (table.solver == EXACT) & (table.samples > 0)].iterrows():
        sentences.append(
            f"Compiled and back to back, not on the schedule, {marked(line.solver)} processes {line.samples:,} rows "
            f"with {_tail(line, 'service')} each, at most {number(line.service_max_us)} µs."
        )
    return sentences


def _staleness(table: pd.DataFrame, settings: StreamSettings) -> list[str]:
    """Cost gaps of the first answer, of the paper's method and of the exact solver."""
    costs = []
    for text, selected in (
        ("the first answer, if it is kept,", table.is_floor),
        (
            "the paper's one projected step a sample (compiled, not on the schedule)",
            (table.solver == PAPER) & ~table.paced & (table.settings == json.dumps({"steps": 1})),
        ),
        (
            f"{marked(EXACT)} (direct) with the exact optimum at every sample",
            (table.solver == EXACT) & table.paced & (table.lane == Lane.DIRECT),
        ),
    ):
        costs += [
            f"{text} is {percent(line.gap_mean)} above the optimal cost on average and {percent(line.gap_max)} at most"
            for _, line in table[selected & table.gap_mean.notna()].head(1).iterrows()
        ]
    seconds = settings.samples * PERIOD_NS * 1e-9
    return [f"Over {seconds:.3g} s of drift {'; '.join(costs)}."] if costs else []


def _tail(line: pd.Series, kind: str) -> str:
    """The median and the farthest percentile that the sample supports."""
    known = [
        f"{Percentile(q).name} {number(line[column(kind, q)])} µs" for q in QUANTILES if line[column(kind, q)] >= 0
    ]
    return " and ".join(known[:1] + known[1:][-1:]) or "too few samples to say"
