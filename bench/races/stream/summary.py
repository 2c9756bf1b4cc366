"""Numbers of a stream race; `report` renders them.

A row of the *summary* is one solver in one lane, at one tier, with its setting, over its processes. Late answers come
in bouts, since a delay of the machine makes one sample after the other late; so bouts (runs of late samples) are
compared with those of the null solver, the machine itself: their rates have a ratio with a 95 % interval. A solver is
late if the whole interval is above 1. If the machine itself misses too many deadlines, no solver keeps the schedule. A
percentile of response times is above the floor if its whole interval lies above the floor's.

The deadline profile of a solver is the share of samples that are answered within k sampling periods of their due time.
A latency tail is the response time by percentile, as far as the number of samples supports it.
"""

import math
from collections.abc import Hashable

import numpy as np
import pandas as pd

from bench.derived.measurements import FLOOR, Microseconds
from bench.messages.columns import combined
from bench.messages.task import Status
from bench.races.stream.race import STREAM
from bench.report.report import BEST, together
from bench.report.words import marked, settings_label
from bench.timing.percentiles import QUANTILES, Percentile, needed, percentile, rate_ratio
from bench.timing.schedule import PERIOD_US, runs

GROUP = ["solver", "lane", "tier", "settings", "setting"]
FLOOR_NAME = "the machine's floor"
TOLERATED_FLOOR = 0.01
"""Largest share of deadlines missed by the machine itself in a run that can tell who keeps the schedule."""
FAILURES = tuple(
    str(status)
    for status in (Status.ADAPTER_FAILED, Status.UNSUPPORTED, Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY)
)
DECADES = np.geomspace(0.5, 1e-6, 60)
FARTHEST_PERIODS = 1_000
"""Sampling periods up to which the deadline profile goes."""
ID_COLUMNS = ["view", "name", "solver", "lane"]
Lines = list[tuple[pd.Series, Microseconds]]
"""Lines of the summary by name, each with its sorted times in µs."""


def column(kind: str, q: float, end: str = "") -> str:
    """Column of a percentile, such as ``response_p99.9_us`` or ``response_p99.9_low_us``."""
    return f"{kind}_{Percentile(q).name}{f'_{end}' if end else ''}_us"


def raw(rows: pd.DataFrame, times: pd.DataFrame, what: str) -> dict[tuple[Hashable, ...], Microseconds]:
    """The raw times of each line, all its processes together, µs."""
    found = rows[["task", *GROUP]].merge(times.loc[times.what == what, ["task", "ns"]], on="task")
    return {key: np.concatenate([*part.ns]) / 1e3 for key, part in found.groupby(GROUP)}


def percentiles(kind: str, microseconds: Microseconds) -> dict[str, float]:
    """Percentiles, ends of their intervals, maximum and number of samples by column; NaN for a refused percentile."""
    columns = {
        column(kind, each.q, end): math.nan if value is None else value
        for each in (percentile(microseconds, q) for q in QUANTILES)
        for end, value in (("", each.value), ("low", each.low), ("high", each.high))
    }
    return columns | {
        f"{kind}_max_us": float(microseconds.max()) if microseconds.size else math.nan,
        f"{kind}_samples": microseconds.size,
    }


def for_deadline(rows: pd.DataFrame, times: pd.DataFrame, deadline_us: float) -> pd.DataFrame:
    """The rows with the misses and bouts of another deadline."""
    response = times[times.what == "response"].set_index("task").ns
    late = [response.get(task, np.zeros(0)) > 1e3 * deadline_us for task in rows.task]
    return rows.assign(missed=[each.sum() for each in late], stalls=[runs(each) for each in late])


def summary(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """One row per solver, lane, tier and settings: the floor, then those that keep up, by median response time."""
    table, figures = combined(rows, STREAM.columns, GROUP), []
    machine = table[table.solver == FLOOR]
    machine_bouts = int(machine.stalls.sum()), int(machine.samples.sum())
    services, responses = raw(rows, times, "service"), raw(rows, times, "response")
    for _, line in table.iterrows():
        key, nothing = tuple(line[GROUP]), np.zeros(0)
        low, high = rate_ratio(int(line.stalls), line.samples, *machine_bouts) if line.samples else (0.0, math.inf)
        figures.append(
            {
                "bouts_ratio_low": low,
                "bouts_ratio_high": high,
                **percentiles("service", services.get(key, nothing)),
                **percentiles("response", responses.get(key, nothing)),
            }
        )
    table = table.join(pd.DataFrame(figures)).assign(is_floor=table.solver == FLOOR)
    late, failed, machine = table.bouts_ratio_low > 1.0, table.status.isin(FAILURES), table[table.is_floor]
    status = table.status.mask(table.is_floor & ~failed, FLOOR)
    keeps = bool((machine.missed <= TOLERATED_FLOOR * machine.samples).all())
    for q in QUANTILES:
        reached = float(machine[column("response", q, "high")].iloc[0]) if len(machine) else math.nan
        table[f"at_floor_{Percentile(q).name}"] = table[column("response", q, "low")] <= reached
    table = table.assign(
        status=status.mask((status == Status.OK) & late, str(Status.LATE)),
        keeps_up=~failed & ~late & keeps,
        machine_keeps=keeps,
    )
    order = ["is_floor", "keeps_up", column("response", 0.5), "solver", "lane", "settings"]
    return table.sort_values(order, ascending=[False, False, True, True, True, True], ignore_index=True)


def _names(table: pd.DataFrame) -> pd.DataFrame:
    """Names of the lines, with the tier if a solver lane has several, and with settings."""
    several = table.groupby(["solver", "lane"]).tier.transform("nunique") > 1
    settings = table.settings.map(settings_label)
    label = (
        table.solver.map(marked)
        + " ("
        + table.lane
        + np.where(several, ", " + table.tier, "")
        + np.where(settings != "", ", " + settings, "")
        + ")"
    )
    return table.assign(
        name=label.where(~table.is_floor, FLOOR_NAME),
        view="stream",
        lane=table.lane.where(~table.is_floor, "the machine"),
    )


def lines(table: pd.DataFrame, rows: pd.DataFrame, times: pd.DataFrame) -> Lines:
    """Response times, the machine's floor first and then the fastest."""
    ran, responses = table[table.response_samples > 0], raw(rows, times, "response")
    found = [
        (shown, np.sort(responses[tuple(line[GROUP])]))
        for (_, line), (_, shown) in zip(ran.iterrows(), _names(ran).iterrows(), strict=True)
    ]
    return sorted(found, key=lambda pair: (not pair[0].is_floor, float(np.quantile(pair[1], 0.99))))


def deadline_profile(lines: Lines) -> pd.DataFrame:
    """Share of samples answered within k periods, one row per solver lane and k."""
    ks = np.unique(np.geomspace(1, FARTHEST_PERIODS, 40).round()).astype(int)
    return together(
        [pd.DataFrame(columns=[*ID_COLUMNS, "periods", "share", "samples", "front"])]
        + [
            pd.DataFrame(
                {
                    **line[ID_COLUMNS],
                    "periods": ks,
                    "samples": us.size,
                    "front": rank < BEST,
                    "share": np.searchsorted(us, ks * PERIOD_US, side="right") / us.size,
                }
            )
            for rank, (line, us) in enumerate(lines)
        ]
    )


def latency_tails(lines: Lines) -> pd.DataFrame:
    """Response time against the share of samples above it."""
    parts = [pd.DataFrame(columns=[*ID_COLUMNS, "one_in", "us", "front"])]
    for rank, (line, us) in enumerate(lines):
        shares = np.array([share for share in DECADES if needed(1.0 - share) <= us.size])
        ranks = np.ceil(np.round((1.0 - shares) * us.size, 6)).astype(int) - 1
        tail = {"one_in": 1.0 / shares, "us": us[ranks], "front": rank < BEST}
        parts.append(pd.DataFrame({**line[ID_COLUMNS], **tail}))
    return together(parts)
